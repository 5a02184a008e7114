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


class Setting(NamedTuple):
    """A value that a register is to have."""

    register: Register
    value: int


def eeprom_settings(servo: ServoSpec, bus: BusSpec, table: ControlTable) -> list[Setting]:
    """What must stand in EEPROM, which is writable with torque off alone."""
    values = {"return_delay_time": bus.return_delay_value}
    if table.protocol == 2:
        values["operating_mode"] = MODES[servo.mode]
    else:
        values["status_return_level"] = ANSWER_ALL
    return _settings(table, values)


def ram_settings(servo: ServoSpec, table: ControlTable) -> list[Setting]:
    """What must stand in RAM: lost in a reboot, and reset by a change of mode. Goals are paced by us: no profile."""
    gains = servo.gains
    values: dict[str, int | None] = {
        "status_return_level": ANSWER_ALL,
        "feedforward_1st_gain": gains.feedforward_1,
        "feedforward_2nd_gain": gains.feedforward_2,
        "profile_acceleration": 0,
        "profile_velocity": 0,
        "moving_speed": 0,  # as fast as it can
        "goal_acceleration": 0,
    }
    names = ("position_p_gain", "position_i_gain", "position_d_gain")
    if table.protocol == 1:
        names = ("p_gain", "i_gain", "d_gain")
        del values["status_return_level"]  # it stands in EEPROM
    values |= dict(zip(names, (gains.position_p, gains.position_i, gains.position_d), strict=True))
    return _settings(table, values)


def full_drive(servo: ServoSpec, image: ServoImage) -> Setting:
    """The register that limits the servo's drive, at what it is to be while the robot moves."""
    table = image.table
    if table.protocol == 1:
        return Setting(table["torque_limit"], image.value("max_torque"))
    if servo.mode is ServoMode.CURRENT_BASED_POSITION:
        assert servo.current_limit is not None
        unit = table["goal_current"].scale or 1.0
        return Setting(table["goal_current"], min(round(servo.current_limit / unit), image.value("current_limit")))
    return Setting(table["goal_pwm"], image.value("pwm_limit"))


def differing(settings: list[Setting], image: ServoImage) -> list[Setting]:
    """Those that the servo does not have yet."""
    return [setting for setting in settings if image.value(setting.register.name) != setting.value]


def _settings(table: ControlTable, values: "dict[str, int] | dict[str, int | None]") -> list[Setting]:
    return [Setting(table[name], value) for name, value in values.items() if value is not None and table.has(name)]
