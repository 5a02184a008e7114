"""Goal registers of a 2.0 servo: what resets them, what bounds them, and how they become motion."""

from sim.emulator.motion import Law, Shaft
from sim.emulator.registers import Memory
from sim.emulator.rules import GOAL_LIMITS, GOALS, goal_bounds
from sim.emulator.tuning import goal_speed, path_to, velocity_ramp


def reset_for_mode(memory: Memory) -> None:
    """Reset what a change of the operating mode resets: gains, profile, goal PWM and goal current (e-Manual, 11)."""
    for register in memory.table.registers:
        if register.name.endswith("_gain"):
            memory.store(register, register.initial or 0)
    memory.put("profile_acceleration", 0)
    memory.put("profile_velocity", 0)
    open_limits(memory)


def open_limits(memory: Memory) -> None:
    """Goal PWM and goal current := their limits."""
    for goal, limit in GOAL_LIMITS[:2]:
        memory.put(goal, memory.value_or(limit, 0))


def bound_goals(memory: Memory) -> None:
    """Pull goal registers inside limits that have moved."""
    for name in GOALS:
        if memory.table.has(name):
            low, high = goal_bounds(memory, name)
            memory.put(name, max(min(memory.value(name), high), low))


def goal_to_present(memory: Memory, position: float) -> None:
    """Let the goal position register show where the servo is (tick), within its limits."""
    low, high = goal_bounds(memory, "goal_position")
    memory.put("goal_position", max(min(round(position), high), low))


def aim(shaft: Shaft, memory: Memory, *, tick: float, now: float, fresh: bool) -> None:
    """Send the shaft to what the goal registers hold. tick: rad; fresh: torque has just come on, so that a profile
    starts where the shaft is, and at rest."""
    if shaft.law is Law.POSITION:
        goal = memory.value("goal_position")
        shaft.path = path_to(goal, memory, tick, at=_here(shaft, fresh), now=now)
        shaft.target = goal
    else:
        shaft.path = None
        shaft.speed = goal_speed(memory, tick)
        if shaft.law is Law.VELOCITY:
            shaft.ramp = velocity_ramp(memory, tick, shaft.speed - shaft.trajectory()[1])
    shaft.refresh()


def _here(shaft: Shaft, fresh: bool) -> tuple[float, float]:
    """Where a new profile begins, (tick, tick/s): on the old one, or where the loop holds, or where the shaft is."""
    if fresh:
        return shaft.position, 0.0
    if shaft.path is not None or abs(shaft.target - shaft.position) < shaft.lag * shaft.full:
        return shaft.trajectory()
    return shaft.position, shaft.velocity
