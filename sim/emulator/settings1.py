"""From the registers of a 1.0 servo to the numbers of its loop, and back to the registers that show its state."""

from enum import Enum, auto
from math import inf

from hardware.servo import ServoModel
from hardware.servo_lag import DEFAULT_P_GAIN, lag_of_gain
from sim.emulator.motion import Law, Shaft
from sim.emulator.power import Electrics
from sim.emulator.registers import Memory
from sim.servo_load import IDLE_CURRENT, LARGEST_CURRENT

FULL_TORQUE = 1023.0
DEFAULT_SLOPE = 32  # compliance slope of an AX-12A, and P gain of an MX
STILL = 0.01  # share of the top speed below which Moving (46) is 0
_TICKS = 32768  # the realtime tick wraps, ms


class Mode1(Enum):
    """What the two angle limits make of a servo (e-Manual, 6 and 8)."""

    JOINT = auto()
    WHEEL = auto()
    MULTI_TURN = auto()


def mode_of(memory: Memory) -> Mode1:
    """Return the mode that the angle limits stand for."""
    limits = memory.value("cw_angle_limit"), memory.value("ccw_angle_limit")
    if limits == (0, 0):
        return Mode1.WHEEL
    turns = memory.table.has("multi_turn_offset")
    return Mode1.MULTI_TURN if turns and limits == (4095, 4095) else Mode1.JOINT


def goal_bounds1(memory: Memory) -> tuple[int, int]:
    """Return the lowest and highest goal position that is taken."""
    mode = mode_of(memory)
    if mode is Mode1.JOINT:
        return memory.value("cw_angle_limit"), memory.value("ccw_angle_limit")
    register = memory.table["goal_position"]
    return register.lowest or 0, register.highest or 0


def shown_position(memory: Memory, position: float, *, back: bool = False) -> float:
    """Return what the registers show for a shaft `position` (tick); back: the shaft position for what they show.

    Only multi-turn mode knows offset and divider (e-Manual, 20 and 22).
    """
    if mode_of(memory) is not Mode1.MULTI_TURN:
        return position
    offset, divider = memory.value("multi_turn_offset"), max(memory.value("resolution_divider"), 1)
    return (position - offset) * divider if back else position / divider + offset


def tune_loop1(shaft: Shaft, memory: Memory, model: ServoModel, supplied: float) -> None:
    """Set law, gains and limits of `shaft`; supplied: supply as a share of the nominal voltage.

    The default gain, or compliance slope, gives the loop that the mock bus has.
    """
    wheel = mode_of(memory) is Mode1.WHEEL
    shaft.law = Law.VELOCITY if wheel else Law.POSITION
    if memory.value_or("torque_ctrl_mode_enable", 0):
        shaft.law = Law.CURRENT
    shaft.full = model.no_load_speed / model.tick_rad * supplied
    shaft.drive_limit = memory.value("torque_limit") / FULL_TORQUE
    shaft.lag, shaft.integral = inf, 0.0
    gain = memory.value("p_gain") if memory.table.has("p_gain") else 0
    slope = memory.value_or("cw_compliance_slope", 0)
    softness = DEFAULT_SLOPE / gain if gain else max(slope, 1) / DEFAULT_SLOPE
    if supplied > 0.0 and (gain or not memory.table.has("p_gain")):
        shaft.lag = lag_of_gain(model, DEFAULT_P_GAIN) * softness / supplied
        shaft.integral = memory.value("i_gain") * 1000.0 / 2048.0 / (gain / 8.0) if gain else 0.0


def live1(memory: Memory, shaft: Shaft, electrics: Electrics, model: ServoModel, *, uptime: float) -> None:
    """Refresh the registers that show the state of a servo that started `uptime` s ago."""
    table = memory.table
    unit = (table["present_speed"].scale or 1.0) / model.tick_rad
    load = min(max(electrics.current - IDLE_CURRENT, 0.0) / LARGEST_CURRENT, 1.0)
    memory.put("present_position", round(shown_position(memory, shaft.position)))
    memory.put("present_speed", round(shaft.velocity / unit))
    memory.put("present_load", round(electrics.direction * FULL_TORQUE * load))
    memory.put("present_voltage", round(10.0 * electrics.voltage))
    memory.put("present_temperature", round(electrics.warmth))
    memory.put("moving", int(abs(shaft.velocity) > STILL * shaft.full))
    memory.put("realtime_tick", int(1000.0 * uptime) % _TICKS)
