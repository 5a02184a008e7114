"""A servo's settings: its registers as read, the values that its profile wants, and the plan of what to write."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from hardware.bus import BAUDS, MAX_RETURN_DELAY, RETURN_DELAY_STEP, BusSpec
from hardware.dynamixel.codec import MAX_ID
from hardware.dynamixel.control_table import ControlTable, Register, baud_of, code_of
from hardware.dynamixel.single_requests import OneOff
from hardware.errors import BusError
from hardware.servo import Layout, ServoMode, ServoSpec

# The registers of one servo, read in a few blocks before anything moves.

CHUNK = 64
"""Most bytes that are read at once."""
LAST = ("present_temperature", "hardware_error_status", "lock", "goal_acceleration")
"""The last registers that are read: no table has one of interest behind them."""


@dataclass(frozen=True, eq=False)
class ServoImage:
    """Registers of a servo with this table, as read once: later changes of the servo are not in it."""

    table: ControlTable
    data: bytes

    def has(self, name: str) -> bool:
        """Whether the register is there."""
        return self.table.has(name) and self.table[name].end <= len(self.data)

    def value(self, name: str) -> int:
        """A register's value, counts."""
        register = self.table[name]
        return register.decode(self.data[register.address : register.end])


def read_image(client: OneOff, device: int, table: ControlTable) -> ServoImage:
    """Everything from address 0 to the last register of LAST. Raises BusError when it does not answer."""
    last = max(table[name].end for name in LAST if table.has(name))
    parts = [client.read_block(device, at, min(CHUNK, last - at)) for at in range(0, last, CHUNK)]
    return ServoImage(table, b"".join(parts))


MODES = {ServoMode.POSITION: 3, ServoMode.EXTENDED_POSITION: 4, ServoMode.CURRENT_BASED_POSITION: 5}
"""Operating Mode, register 11."""
JOINT_MODE = 2
"""Control Mode, register 11 of the XL-320: it follows a position."""
ANSWER_ALL = 2
"""Status Return Level: every instruction is answered."""
WAKING = {"moving_speed": 0}
"""Written to a limp servo only when its torque may come on: like a goal position, a moving speed of the older layout
switches torque on (field knowledge of protocol 1.0, in no manual). 0: full speed."""


class Setting(NamedTuple):
    """A value that a register is to have."""

    register: Register
    value: int


def eeprom_settings(servo: ServoSpec, bus: BusSpec, table: ControlTable) -> list[Setting]:
    """The values that EEPROM must hold; it is writable only with torque off."""
    values = {
        "return_delay_time": bus.return_delay_value,
        "operating_mode": MODES[servo.mode],
        "control_mode": JOINT_MODE,
        "status_return_level": ANSWER_ALL,
    }
    if servo.current_limit is not None and not _by_current(servo) and table.has("current_limit"):
        values["current_limit"] = _current(servo, table["current_limit"])
    return [setting for setting in _settings(table, values) if setting.register.address < table.eeprom_end]


def ram_settings(servo: ServoSpec, image: ServoImage) -> list[Setting]:
    """The values that RAM must hold; a reboot or a change of mode resets them. The goals limit speed and acceleration
    themselves, so the servo has no profile."""
    gains, table = servo.gains, image.table
    values: dict[str, int | None] = {
        "status_return_level": ANSWER_ALL,
        "feedforward_1st_gain": gains.feedforward_1,
        "feedforward_2nd_gain": gains.feedforward_2,
        "profile_acceleration": 0,
        "profile_velocity": 0,
        "goal_acceleration": 0,
        "torque_ctrl_mode_enable": 0,  # 1.0: it follows a torque, not a position
    }
    values |= WAKING
    if _by_current(servo):
        values["goal_pwm"] = image.value("pwm_limit")  # it limits the drive as well as the current does
    own = "" if table.layout is Layout.OLDER else "position_"
    values |= {f"{own}p_gain": gains.position_p, f"{own}i_gain": gains.position_i, f"{own}d_gain": gains.position_d}
    return [setting for setting in _settings(table, values) if setting.register.address >= table.eeprom_end]


def full_drive(servo: ServoSpec, image: ServoImage) -> Setting:
    """The register that limits the servo's drive, with its value while the robot moves."""
    table = image.table
    if table.has("torque_limit"):
        return Setting(table["torque_limit"], image.value("max_torque"))
    if _by_current(servo):
        most = _current(servo, table["goal_current"])
        return Setting(table["goal_current"], min(most, image.value("current_limit")))
    return Setting(table["goal_pwm"], image.value("pwm_limit"))


def differing(settings: list[Setting], image: ServoImage) -> list[Setting]:
    """The settings that the servo does not hold yet."""
    return [setting for setting in settings if image.value(setting.register.name) != setting.value]


def _by_current(servo: ServoSpec) -> bool:
    """Whether the mode limits the drive by a current that may change at any time."""
    return servo.mode is ServoMode.CURRENT_BASED_POSITION


def _current(servo: ServoSpec, register: Register) -> int:
    """The profile's current in counts of a register, rounded and clamped."""
    assert servo.current_limit is not None
    most = register.widest if register.highest is None else register.highest
    return min(max(round(servo.current_limit / (register.scale or 1.0)), 1), most)


def _settings(table: ControlTable, values: "dict[str, int] | dict[str, int | None]") -> list[Setting]:
    return [Setting(table[name], value) for name, value in values.items() if value is not None and table.has(name)]


# The plan for a servo's EEPROM: checked as a whole before anything is written; id and speed come last.

OWN_OPTION = {"id": "--new-id", "baud_rate": "--baud", "return_delay_time": "--return-delay"}
SILENCING = "protocol_type"
"""A servo whose protocol is changed no longer answers."""


def setup_command(
    bus: BusSpec, device: int, registers: Mapping[str, int] | None = None, *, baud: int | None = None
) -> str:
    """The command that writes these registers into a servo; baud: bits/s."""
    words = [f"--register {name}={value}" for name, value in (registers or {}).items()]
    if baud is not None:
        words.append(f"--baud {baud}")
    return " ".join([f"`retarget servo setup --port {bus.port} --id {device}", *words]) + "`"


@dataclass(frozen=True)
class Asked:
    """Values for one servo; None: not given. baud: bits/s; return_delay: s; registers: counts by name."""

    new_id: int | None = None
    baud: int | None = None
    return_delay: float | None = None
    registers: Mapping[str, int] = field(default_factory=dict)


def settings_of(table: ControlTable, asked: Asked) -> list[Setting]:
    """The settings for these values, in the order in which they are written.

    Raises BusError (HardwareError for an unknown register) for values that a servo with this table cannot hold.
    """
    wanted = [setting_of(table, name, value) for name, value in asked.registers.items()]
    new_id, baud, return_delay = asked.new_id, asked.baud, asked.return_delay
    if return_delay is not None:
        steps = return_delay / RETURN_DELAY_STEP
        if not (0.0 <= return_delay <= MAX_RETURN_DELAY and abs(steps - round(steps)) < 1e-6):
            allowed = f"0 to {1e6 * MAX_RETURN_DELAY:g} us, even"
            raise _no(table, "return delay", f"{1e6 * return_delay:g} us", allowed)
        wanted.append(Setting(table["return_delay_time"], round(steps)))
    if new_id is not None:
        if not 0 <= new_id <= MAX_ID:
            raise _no(table, "id", str(new_id), f"0 to {MAX_ID}: 254 is the broadcast id")
        wanted.append(Setting(table["id"], new_id))
    if baud is not None:
        code = code_of(table, baud)
        if code is None:
            rates = [rate for rate in BAUDS[table.protocol] if code_of(table, rate) is not None]
            raise _no(table, "baud rate", str(baud), ", ".join(map(str, rates)))
        wanted.append(Setting(table["baud_rate"], code))
    return wanted


def plan(image: ServoImage, wanted: list[Setting]) -> list[Setting]:
    """The settings to write: those that the servo does not hold already. Raises BusError with torque on."""
    due = differing(wanted, image)
    if due and image.value("torque_enable"):
        raise BusError(
            "torque is on, and locks the EEPROM",
            where=image.table.model,
            then="Secure the robot, then `retarget servo rest`",
        )
    return due


def setting_of(table: ControlTable, name: str, value: int) -> Setting:
    """A setting of an EEPROM register. Raises BusError (HardwareError for an unknown register)."""
    register = table[name]
    if name in OWN_OPTION:
        raise _no(table, "register", name, f"the option {OWN_OPTION[name]}")
    if not register.writable or register.address >= table.eeprom_end or name == SILENCING:
        eeprom = [one.name for one in table.registers if one.writable and one.address < table.eeprom_end]
        raise _no(table, "register", name, ", ".join(one for one in eeprom if one != SILENCING))
    if not register.allows(value) or not register.narrowest <= value <= register.widest:
        low = register.narrowest if register.lowest is None else register.lowest
        high = register.widest if register.highest is None else register.highest
        raise _no(table, name, str(value), f"{low} to {high}")
    return Setting(register, value)


def _no(table: ControlTable, what: str, found: str, allowed: str) -> BusError:
    return BusError(f"no such {what} for this servo", where=table.model, found=found, allowed=allowed)


# Counts of a servo's registers in units and words.

TICKS = frozenset(("homing_offset", "min_position_limit", "max_position_limit", "cw_angle_limit", "ccw_angle_limit"))
"""Registers whose counts are ticks of the shaft."""


def in_units(table: ControlTable, name: str, value: int) -> str:
    """The meaning of `value` counts: in SI units or words, angles in degrees; "" where the count is enough."""
    if name == "baud_rate":
        return str(baud_of(table, value) or "")
    if name == "return_delay_time":
        return f"{1e6 * RETURN_DELAY_STEP * value:.0f} us"
    if name == "operating_mode":
        return next((mode.value for mode, code in MODES.items() if code == value), "")
    if name in ("drive_mode", "startup_configuration", "shutdown", "alarm_led"):
        return f"0x{value:02x}"
    register = table[name]
    if register.scale is None or register.unit is None:
        return ""
    if name in TICKS and register.unit == "rad":
        return f"{math.degrees(value * register.scale):.1f} deg"
    return f"{value * register.scale:.4g} {register.unit}"
