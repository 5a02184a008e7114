"""What a servo of protocol 2.0 refuses to write, register by register (facts of the e-Manual's control tables)."""

from typing import NamedTuple

from hardware.dynamixel.packets import Error2
from sim.emulator.registers import Memory, Part

CURRENT, VELOCITY, POSITION, EXTENDED, CURRENT_POSITION, PWM = 0, 1, 3, 4, 5, 16
"""Values of Operating Mode (11)."""
GOALS = frozenset(("goal_pwm", "goal_current", "goal_velocity", "goal_position"))
GOAL_LIMITS = (("goal_pwm", "pwm_limit"), ("goal_current", "current_limit"), ("goal_velocity", "velocity_limit"))
"""Goals, and the registers that bound their magnitude."""
TIME_BASED = 0x04  # bit of Drive Mode (10)
MAX_PROFILE_TIME = 32737  # [ms] of 108 and 112 with a time-based profile
_BITS = frozenset(("drive_mode", "startup_configuration"))  # their `highest` is a mask
_LIMIT_OF = dict(GOAL_LIMITS)


class Condition(NamedTuple):
    """What else a write depends on: torque is on; torque is refused since an error is latched; the bus watchdog has
    tripped."""

    torque: bool
    barred: bool
    tripped: bool


def refusal(memory: Memory, part: Part, condition: Condition) -> Error2:
    """Return why `part` cannot be written now, Error2.NONE when it can."""
    register, value = part
    name = register.name
    if not register.writable or (condition.torque and register.address < memory.table.eeprom_end):
        return Error2.ACCESS
    if not register.allows(value) or not _known(memory, name, value):
        return Error2.DATA_RANGE
    if name in GOALS:
        if condition.tripped:
            return Error2.DATA_RANGE
        low, high = goal_bounds(memory, name)
        return Error2.NONE if low <= value <= high else Error2.DATA_LIMIT
    if name == "bus_watchdog" and condition.tripped and value:
        return Error2.DATA_RANGE
    if name == "torque_enable" and value and condition.barred:
        return Error2.RESULT_FAIL
    return Error2.NONE


def goal_bounds(memory: Memory, name: str) -> tuple[int, int]:
    """Return the lowest and highest counts that a goal register takes with the present limits and mode."""
    limit = _LIMIT_OF.get(name)
    if limit is not None:
        most = memory.value(limit)
        return -most, most
    if memory.value("operating_mode") == POSITION:
        return memory.value("min_position_limit"), memory.value("max_position_limit")
    register = memory.table["goal_position"]
    return register.lowest or 0, register.highest or 0


def _known(memory: Memory, name: str, value: int) -> bool:
    """Whether a value inside the register's range is one that has a meaning."""
    if name == "operating_mode":
        return value in memory.table.modes
    if name in _BITS:
        return not value & ~(memory.table[name].highest or 0)
    if name in ("profile_velocity", "profile_acceleration") and memory.value_or("drive_mode", 0) & TIME_BASED:
        return value <= MAX_PROFILE_TIME
    if name == "protocol_type":
        # Protocol 1.0 and the radio protocols over the X tables are not emulated: the servo stays with 2.0.
        return value == 2
    return True
