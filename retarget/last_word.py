"""What a robot's goals pass last: the gate, with what it asks about collision, or none; and what holds the robot up."""

from collections.abc import Callable
from dataclasses import dataclass

from hardware.arrays import FloatArray
from hardware.goal_filter import GoalFilter
from retarget.follow import Follower
from retarget.gate import Gate, PathCheck
from retarget.open_gate import OpenGate
from retarget.path_clearance import PathClearance
from retarget.priorities import Priorities
from retarget.robot_body import RobotBody
from retarget.upheld_goals import HeldPath, UpheldGoals

__all__ = ["LastWord", "last_word"]


@dataclass(frozen=True, eq=False)
class LastWord:
    """goals: what the guard sends everything through. passes: whether it would hold the robot in a posture, None
    without a gate. clearance: its look at collision, None without a gate or without observers."""

    goals: GoalFilter
    passes: Callable[[FloatArray], bool] | None
    clearance: PathClearance | None


def last_word(robot: RobotBody, follower: Follower, priorities: Priorities, *, gate: bool, dt: float) -> LastWord:
    """Of one robot, in ticks of `dt` s. gate: whether there is one; without it goals are postures."""
    servos, caps = robot.joint_map, robot.profile.safety.speed_caps
    if not gate:
        return LastWord(OpenGate(servos.max_acceleration, dt=dt), None, None)
    observers, speed = follower.hierarchy.observers, max(caps.follow, caps.approach)
    clearance = None if observers is None else PathClearance(robot, observers, follower.surroundings, dt=dt)

    def gate_with(path_is_clear: PathCheck | None) -> Gate:
        return Gate.for_servos(servos, dt=dt, speed=speed, path_is_clear=path_is_clear)

    uphold = priorities.uphold
    if uphold is None or not follower.stance.soles:
        plain = gate_with(clearance)
        return LastWord(plain, plain.passes, clearance)
    held = None if clearance is None else HeldPath(clearance)
    steps = follower.steps is not None
    upheld = UpheldGoals(gate_with(held), robot, follower.stance, dt=dt, settle=uphold.settle, held=held, steps=steps)
    return LastWord(upheld, upheld.passes, clearance)
