"""From the registers of a 2.0 servo to the numbers of its loop: gains, limits, profile.

Units that the e-Manual leaves open are chosen so that one register step keeps its sense: PWM counts per tick of error
(P), per tick and ms (I), per tick/ms (D and first feedforward). The default D gain belongs to the loop that the P gain
alone describes, as in the mock bus; only what is set beyond it damps. The second feedforward gain and the velocity
gains have no effect on a motor without inertia.
"""

from math import inf

from hardware.servo import ServoModel
from hardware.servo_lag import FULL_PWM, GAIN_UNIT, lag_of_gain
from sim.emulator.motion import Law, Shaft
from sim.emulator.profile_path import ProfilePath, path_by_time, path_by_velocity
from sim.emulator.registers import Memory
from sim.emulator.rules import CURRENT, CURRENT_POSITION, PWM, TIME_BASED, VELOCITY

_LAWS = {CURRENT: Law.CURRENT, VELOCITY: Law.VELOCITY, PWM: Law.PWM}


def tune_loop(shaft: Shaft, memory: Memory, model: ServoModel, supplied: float) -> None:
    """Set law, gains and limits of `shaft`; supplied: supply as a share of the nominal voltage."""
    mode = memory.value("operating_mode")
    gain = memory.value("position_p_gain")
    shaft.law = _LAWS.get(mode, Law.POSITION)
    shaft.full = model.no_load_speed / model.tick_rad * supplied
    shaft.lag = inf
    shaft.integral = shaft.forward = 0.0
    if gain and supplied > 0.0:
        damping = max(memory.value("position_d_gain") - (memory.table["position_d_gain"].initial or 0), 0) / 16.0
        per_tick = gain / GAIN_UNIT  # PWM counts
        shaft.lag = lag_of_gain(model, gain) / supplied + 1e-3 * damping / per_tick
        shaft.integral = 1e3 * memory.value("position_i_gain") / 65536.0 / per_tick
        shaft.forward = 1e-3 * memory.value("feedforward_1st_gain") / 4.0 / per_tick
    share = abs(memory.value("goal_pwm")) / FULL_PWM
    shaft.drive_limit = memory.value("pwm_limit") / FULL_PWM if mode == PWM else share
    shaft.current_limit = inf
    if mode == CURRENT_POSITION:
        shaft.current_limit = abs(memory.value("goal_current")) * (memory.table["goal_current"].scale or 0.0)


def goal_speed(memory: Memory, tick: float) -> float:
    """Return the goal of the laws other than position: tick/s, A or share of full drive; `tick` rad."""
    mode = memory.value("operating_mode")
    if mode == CURRENT:
        return memory.value("goal_current") * (memory.table["goal_current"].scale or 0.0)
    if mode == PWM:
        return memory.value("goal_pwm") / FULL_PWM
    return memory.value("goal_velocity") * (memory.table["goal_velocity"].scale or 0.0) / tick


def velocity_ramp(memory: Memory, tick: float, change: float) -> float:
    """Return the acceleration, tick/s^2, towards a goal velocity that is `change` tick/s away; inf: at once."""
    value = memory.value("profile_acceleration")
    if not value:
        return inf
    if memory.value_or("drive_mode", 0) & TIME_BASED:
        return max(abs(change), 1.0) / (1e-3 * value)
    return value * (memory.table["profile_acceleration"].scale or 0.0) / tick


def path_to(goal: int, memory: Memory, tick: float, *, at: tuple[float, float], now: float) -> ProfilePath | None:
    """Return the profile to `goal` from `at` (tick, tick/s), None where Profile Velocity says step; `tick` rad."""
    top, ramp = memory.value("profile_velocity"), memory.value("profile_acceleration")
    if not top:
        return None
    position, velocity = at
    if memory.value_or("drive_mode", 0) & TIME_BASED:
        return path_by_time(goal, position=position, velocity=velocity, total=1e-3 * top, ramp=1e-3 * ramp, now=now)
    speed = min(top, max(memory.value("velocity_limit"), 1)) * (memory.table["profile_velocity"].scale or 0.0) / tick
    rate = ramp * (memory.table["profile_acceleration"].scale or 0.0) / tick
    return path_by_velocity(goal, position=position, velocity=velocity, top=speed, acceleration=rate, now=now)
