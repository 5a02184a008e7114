"""The way of a robot that stands to where it is parked: straight, or around what is in the way."""

from collections.abc import Callable, Iterator

import numpy as np

from hardware.guard_state import Stop
from hardware.stop_latch import GOING_HOME
from retarget.approach import approach
from retarget.robot_body import RobotBody
from retarget.robot_reader import standing_dofs
from retarget.rotations import FloatArray

__all__ = ["HOME_S", "LONGEST_HOME_S", "NEAR_REST", "WayHome", "not_parked"]

HOME_S = 2.5
"""So long the straight way takes at most, and each part of one around something; it goes as fast as that asks."""
ALONE_RAD = 0.3
"""So far a joint goes aside alone, before all the arm does."""
LONGEST_HOME_S = 15.0
"""So long all of it takes at most, s; then its torque goes off where it is."""
NEAR_REST = 0.2
"""A robot is parked when no joint is farther than this from posture `rest`, rad."""


class WayHome:
    """To the profile's rest posture, tick by tick of `dt` s.

    First straight there. Where something is in the way, from where the robot stands then: the arms aside, legs still;
    then the whole robot to `stand`, and straight down from there. Arms are aside as in `attractor`; if that is not to
    be had either, as in `stand`, then as in `neutral`. Then joint by joint, the outermost first: one joint of an arm
    alone goes aside, then the rest as before - what keeps a hand off its own forearm may be a wrist that goes first.
    After that it stays.
    """

    def __init__(self, robot: RobotBody, *, dt: float, passes: Callable[[FloatArray], bool] | None = None) -> None:
        """passes: whether a goal (n,) rad would be sent now; a try whose first is not is none: where nothing moves, the
        stop would be over."""
        self._robot, self._dt, self._passes = robot, dt, passes
        self._way: Iterator[FloatArray] | None = None
        self._tries = 0
        self._arrived = False
        self._outermost = _outermost(robot)

    @property
    def begun(self) -> bool:
        """Whether the robot has set off, and perhaps arrived."""
        return self._way is not None

    def next(self, here: FloatArray, *, passed: bool, stands: bool) -> FloatArray | None:
        """The next goal (n,) rad; None: it is there, cannot go on, or has to come to a stand first.

        here (n,): rad, where the robot is; passed: whether the goal before was sent as it was; stands: whether nothing
        is left to brake.
        """
        if self._way is None:
            self._way = self._next_try(here)
        elif not (passed or self._arrived):  # something is in the way
            self._way = self._next_try(here) if stands else iter(())
            if not stands:
                return None
        goal = next(self._way, None)
        while stands and goal is not None and self._passes is not None and not self._passes(goal):
            self._way = self._next_try(here)
            goal = next(self._way, None)
        self._arrived |= goal is None
        return goal

    def _next_try(self, here: FloatArray) -> Iterator[FloatArray]:
        """Goals (n,) rad of one more try; none where all have been made."""
        tried, self._tries = self._tries, self._tries + 1
        postures = self._robot.profile.postures
        stand, rest = self._angles(postures.stand), self._angles(postures.rest)
        if tried == 0:
            return self._through(here, [rest])
        asides = (postures.attractor, postures.stand, postures.neutral)
        first = here
        if tried > len(asides):
            alone = tried - len(asides) - 1
            if alone >= len(self._outermost):
                return iter(())
            first, joint = here.copy(), self._outermost[alone]
            first[joint] += float(np.clip(self._angles(postures.attractor)[joint] - here[joint], -ALONE_RAD, ALONE_RAD))
            tried = 1
        aside = self._arms_of(self._angles(asides[tried - 1]), here)
        return self._through(here, [first, aside, stand, rest])

    def _through(self, here: FloatArray, places: list[FloatArray]) -> Iterator[FloatArray]:
        robot, dt = self._robot, self._dt
        speed, within = robot.profile.safety.speed_caps.approach, HOME_S - dt
        for place in places:
            yield from approach(here, place, robot.joint_map, speed=speed, dt=dt, within=within)
            here = place

    def _angles(self, posture: dict[str, float]) -> FloatArray:
        return self._robot.posture(posture)[self._robot.servo_columns]

    def _arms_of(self, posture: FloatArray, legs: FloatArray) -> FloatArray:
        """A posture (n,) with the joints that carry the robot as in another."""
        robot = self._robot
        dofs = [robot.body.dof_index(joint) for joint in robot.joint_map.joints]
        return np.where(standing_dofs(robot)[dofs], legs, posture)


def not_parked(robot: RobotBody, joints: FloatArray, stop: Stop | None) -> tuple[str, ...]:
    """What is to be told of a robot on its soles whose torque went off with `joints` (n,) rad, servo order, though it
    was to be parked and nothing else stopped it."""
    if not robot.stands or (stop is not None and (stop.cause not in GOING_HOME or stop.then is not None)):
        return ()
    off = np.abs(joints - robot.posture(robot.profile.postures.rest)[robot.servo_columns])
    worst = int(off.argmax())
    if off[worst] <= NEAR_REST:
        return ()
    where = f"{robot.joint_map.joints[worst]} {off[worst]:.2f} rad from it"
    return (f"not parked: no way to posture rest was clear; torque went off with {where}",)


def _outermost(robot: RobotBody) -> list[int]:
    """Columns, in servo order, of the joints that do not carry the robot, those farthest from the root first."""
    body = robot.body
    joints = robot.joint_map.joints
    free = ~standing_dofs(robot)[[body.dof_index(joint) for joint in joints]]
    depths = [len(body.chain_to_root(body.joint_body[body.joint_index(joint)])) for joint in joints]
    return sorted(np.flatnonzero(free).tolist(), key=lambda column: -depths[column])
