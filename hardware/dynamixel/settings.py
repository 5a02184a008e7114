"""A servo's settings: its registers as read, the values that its profile requires, and the plan of what to write."""

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

BLOCK_BYTES = 64  # read at once
LAST_REGISTERS = ("present_temperature", "hardware_error_status", "lock", "goal_acceleration")


@dataclass(frozen=True, eq=False)
class ServoImage:
    """Registers of a servo, as read once."""

    table: ControlTable
    data: bytes

    def has(self, name: str) -> bool:
        """True if the register was read."""
        return self.table.has(name) and self.table[name].end <= len(self.data)

    def value(self, name: str) -> int:
        """A register's value, counts."""
        register = self.table[name]
        return register.decode(self.data[register.address : register.end])


def read_image(client: OneOff, device: int, table: ControlTable) -> ServoImage:
    """Read from address 0 to the last of LAST_REGISTERS. Raises BusError without an answer."""
    last = max(table[name].end for name in LAST_REGISTERS if table.has(name))
    parts = [client.read_block(device, at, min(BLOCK_BYTES, last - at)) for at in range(0, last, BLOCK_BYTES)]
    return ServoImage(table, b"".join(parts))


MODES = {ServoMode.POSITION: 3, ServoMode.EXTENDED_POSITION: 4, ServoMode.CURRENT_BASED_POSITION: 5}
"""Operating Mode, register 11."""
JOINT_MODE = 2
"""Control Mode, register 11 of the XL-320: position control."""
ANSWER_ALL = 2
"""Status Return Level: every instruction is answered."""
WAKING = {"moving_speed": 0}
"""Registers written to a limp servo only when its torque may come on, which a moving speed of the older layout switches
on (field knowledge of 1.0, in no manual). 0: full speed."""


class Setting(NamedTuple):
    """Desired value of a register."""

    register: Register
    value: int


def eeprom_settings(servo: ServoSpec, bus: BusSpec, table: ControlTable) -> list[Setting]:
    """The desired EEPROM values, which are writable only with torque off."""
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
    """The desired RAM values, which a reboot or a change of mode resets. Goals limit speed and acceleration, so
    profiles are off."""
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
    """The register that limits the servo's drive, with its value in motion."""
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
    """True if the mode limits the drive by a goal current, which may change at any time."""
    return servo.mode is ServoMode.CURRENT_BASED_POSITION


def _current(servo: ServoSpec, register: Register) -> int:
    assert servo.current_limit is not None
    most = register.widest if register.highest is None else register.highest
    return min(max(round(servo.current_limit / (register.scale or 1.0)), 1), most)


def _settings(table: ControlTable, values: "dict[str, int] | dict[str, int | None]") -> list[Setting]:
    return [Setting(table[name], value) for name, value in values.items() if value is not None and table.has(name)]


OWN_OPTION = {"id": "--new-id", "baud_rate": "--baud", "return_delay_time": "--return-delay"}
SILENCING = "protocol_type"
"""Register after whose change the servo no longer answers."""


def setup_command(
    bus: BusSpec, device: int, registers: Mapping[str, int] | None = None, *, baud: int | None = None
) -> str:
    """The command that writes these registers into a servo. baud: bits/s."""
    words = [f"--register {name}={value}" for name, value in (registers or {}).items()]
    if baud is not None:
        words.append(f"--baud {baud}")
    return " ".join([f"`retarget servo setup --port {bus.port} --id {device}", *words]) + "`"


@dataclass(frozen=True)
class SetupRequest:
    """Requested values of one servo. baud: bits/s. return_delay: s. registers: counts by name."""

    new_id: int | None = None
    baud: int | None = None
    return_delay: float | None = None
    registers: Mapping[str, int] = field(default_factory=dict)


def settings_of(table: ControlTable, request: SetupRequest) -> list[Setting]:
    """The requested settings, id and speed last. Raises BusError for impossible values, HardwareError for an
    unknown register."""
    settings = [setting_of(table, name, value) for name, value in request.registers.items()]
    new_id, baud, return_delay = request.new_id, request.baud, request.return_delay
    if return_delay is not None:
        steps = return_delay / RETURN_DELAY_STEP
        if not (0.0 <= return_delay <= MAX_RETURN_DELAY and abs(steps - round(steps)) < 1e-6):
            allowed = f"0 to {1e6 * MAX_RETURN_DELAY:g} us, even"
            raise _no(table, "return delay", f"{1e6 * return_delay:g} us", allowed)
        settings.append(Setting(table["return_delay_time"], round(steps)))
    if new_id is not None:
        if not 0 <= new_id <= MAX_ID:
            raise _no(table, "id", str(new_id), f"0 to {MAX_ID}: 254 is the broadcast id")
        settings.append(Setting(table["id"], new_id))
    if baud is not None:
        code = code_of(table, baud)
        if code is None:
            rates = [rate for rate in BAUDS[table.protocol] if code_of(table, rate) is not None]
            raise _no(table, "baud rate", str(baud), ", ".join(map(str, rates)))
        settings.append(Setting(table["baud_rate"], code))
    return settings


def plan(image: ServoImage, settings: list[Setting]) -> list[Setting]:
    """The settings that differ from the servo's. Raises BusError with torque on."""
    due = differing(settings, image)
    if due and image.value("torque_enable"):
        raise BusError(
            "torque is on, and locks the EEPROM",
            where=image.table.model,
            then="Secure the robot, then `retarget servo rest`",
        )
    return due


def setting_of(table: ControlTable, name: str, value: int) -> Setting:
    """A setting of an EEPROM register. Raises as `settings_of`."""
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


TICKS = frozenset(("homing_offset", "min_position_limit", "max_position_limit", "cw_angle_limit", "ccw_angle_limit"))


def in_units(table: ControlTable, name: str, value: int) -> str:
    """Return `value` counts in SI units, degrees or words; "" for plain counts."""
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
