"""What a profile wants in a servo's registers, and what has to be written for it."""

from typing import NamedTuple

from hardware.bus_spec import BusSpec
from hardware.dynamixel.control_table import ControlTable
from hardware.dynamixel.register import Register
from hardware.dynamixel.servo_image import ServoImage
from hardware.servo import ServoMode, ServoSpec

MODES = {ServoMode.POSITION: 3, ServoMode.EXTENDED_POSITION: 4, ServoMode.CURRENT_BASED_POSITION: 5}
"""Operating Mode, register 11."""
ANSWER_ALL = 2
"""Status Return Level: every instruction is answered."""
WAKING = {"moving_speed": 0}
"""What a limp servo of protocol 1.0 is told only when its torque may come on: like a goal position, a moving speed
switches it on (field knowledge, in no manual). 0: as fast as it can."""


class Setting(NamedTuple):
    """A value that a register is to have."""

    register: Register
    value: int


def eeprom_settings(servo: ServoSpec, bus: BusSpec, table: ControlTable) -> list[Setting]:
    """What must stand in EEPROM, which is writable with torque off alone."""
    values = {"return_delay_time": bus.return_delay_value}
    if table.protocol == 2:
        values["operating_mode"] = MODES[servo.mode]
        if servo.current_limit is not None and not _by_current(servo) and table.has("current_limit"):
            values["current_limit"] = _current(servo, table["current_limit"])
    else:
        values["status_return_level"] = ANSWER_ALL
    return _settings(table, values)


def ram_settings(servo: ServoSpec, image: ServoImage) -> list[Setting]:
    """What must stand in RAM: lost in a reboot, and reset by a change of mode. Goals are paced by us: no profile."""
    gains, table = servo.gains, image.table
    values: dict[str, int | None] = {
        "feedforward_1st_gain": gains.feedforward_1,
        "feedforward_2nd_gain": gains.feedforward_2,
        "profile_acceleration": 0,
        "profile_velocity": 0,
        "goal_acceleration": 0,
        "torque_ctrl_mode_enable": 0,  # 1.0: it follows a torque, not a position
    }
    names = ("position_p_gain", "position_i_gain", "position_d_gain")
    if table.protocol == 1:
        names = ("p_gain", "i_gain", "d_gain")
        values |= WAKING
    else:
        values["status_return_level"] = ANSWER_ALL  # 1.0: it stands in EEPROM
    if _by_current(servo):
        values["goal_pwm"] = image.value("pwm_limit")  # it limits the drive as well as the current does
    values |= dict(zip(names, (gains.position_p, gains.position_i, gains.position_d), strict=True))
    return _settings(table, values)


def full_drive(servo: ServoSpec, image: ServoImage) -> Setting:
    """The register that limits the servo's drive, at what it is to be while the robot moves."""
    table = image.table
    if table.protocol == 1:
        return Setting(table["torque_limit"], image.value("max_torque"))
    if _by_current(servo):
        most = _current(servo, table["goal_current"])
        return Setting(table["goal_current"], min(most, image.value("current_limit")))
    return Setting(table["goal_pwm"], image.value("pwm_limit"))


def differing(settings: list[Setting], image: ServoImage) -> list[Setting]:
    """Those that the servo does not have yet."""
    return [setting for setting in settings if image.value(setting.register.name) != setting.value]


def _by_current(servo: ServoSpec) -> bool:
    """Whether the mode limits the drive by a current that may change at any time."""
    return servo.mode is ServoMode.CURRENT_BASED_POSITION


def _current(servo: ServoSpec, register: Register) -> int:
    """The profile's current in counts of a register, as near as it can."""
    assert servo.current_limit is not None
    most = register.widest if register.highest is None else register.highest
    return min(max(round(servo.current_limit / (register.scale or 1.0)), 1), most)


def _settings(table: ControlTable, values: "dict[str, int] | dict[str, int | None]") -> list[Setting]:
    return [Setting(table[name], value) for name, value in values.items() if value is not None and table.has(name)]
