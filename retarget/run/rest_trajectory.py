"""From a stop to posture `rest`: a return to stance first, then a rest trajectory that the gate passes."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from enum import Enum
from functools import partial

import numpy as np

from hardware.guard import GOING_TO_REST
from hardware.guard_state import Stop
from retarget.ik.base_pose import plant_root
from retarget.model.robot import RobotBody
from retarget.robot.posture_reader import standing_dofs
from retarget.run.stages import FollowingStage
from retarget.run.trajectory import approach
from retarget.types import BoolArray, FloatArray, Notify

# Trajectories from a stance to rest: straight, or around an obstacle.

Trajectory = Iterator[FloatArray]
"""Goals (n,) rad, one per tick."""
REST_WITHIN_S = 2.5
"""Longest duration of the straight trajectory, and of each part of one around an obstacle, s. The speed follows from
it."""
ALONE_RAD = 0.3
"""Farthest that a joint goes aside alone, before the whole arm does."""
LONGEST_TO_REST_S = 45.0
"""Longest time from the stop to rest, s; then torque goes off where the robot is."""
NEAR_REST = 0.2
"""A robot is at rest when no joint is farther than this from posture `rest`, rad."""


def rest_trajectories(robot: RobotBody, *, dt: float) -> Iterator[Callable[[FloatArray], Trajectory]]:
    """Trajectories to the profile's rest posture in the order in which they are tried, each from where the robot
    stands then, (n,) rad.

    1. Straight to rest.
    2. The arms aside as in `attractor` with the legs still, then the whole robot to `stand`, then straight to rest.
    3. The same with the arms as in `stand`, then as in `neutral`.
    4. For each joint of an arm, the outermost first: that joint alone goes aside, then as in 2. A wrist that moves
       first may keep a hand off its own forearm.
    """
    columns, postures = robot.servo_columns, robot.profile.postures
    attractor, stand, neutral, rest = (
        robot.posture(posture)[columns]
        for posture in (postures.attractor, postures.stand, postures.neutral, postures.rest)
    )
    joints = [robot.body.dof_index(joint) for joint in robot.joint_map.joints]
    carrying = standing_dofs(robot)[joints]

    def through(here: FloatArray, waypoints: Iterable[FloatArray]) -> Trajectory:
        speed, within = robot.profile.safety.speed_caps.approach, REST_WITHIN_S - dt
        for waypoint in waypoints:
            yield from approach(here, waypoint, robot.joint_map, speed=speed, dt=dt, within=within)
            here = waypoint

    def by(aside: FloatArray, alone: int | None, here: FloatArray) -> Trajectory:
        first = here.copy()
        if alone is not None:
            first[alone] += float(np.clip(aside[alone] - here[alone], -ALONE_RAD, ALONE_RAD))
        return through(here, (first, np.where(carrying, here, aside), stand, rest))

    yield lambda here: through(here, (rest,))
    for aside in (attractor, stand, neutral):
        yield partial(by, aside, None)
    for joint in _outermost(robot, carrying):
        yield partial(by, attractor, joint)


def not_at_rest(robot: RobotBody, joints: FloatArray, stop: Stop | None) -> tuple[str, ...]:
    """A note about a robot on its soles whose torque went off away from rest, though nothing but the end of the run or
    a stop that leads to rest ended it. joints (n,): rad, servo order, when torque went off."""
    if not robot.stands or (stop is not None and (stop.cause not in GOING_TO_REST or stop.then is not None)):
        return ()
    off = np.abs(joints - robot.posture(robot.profile.postures.rest)[robot.servo_columns])
    worst = int(off.argmax())
    if off[worst] <= NEAR_REST:
        return ()
    where = f"{robot.joint_map.joints[worst]} {off[worst]:.2f} rad from it"
    return (f"not at rest: no trajectory to posture rest was found in time; torque went off with {where}",)


def _outermost(robot: RobotBody, carrying: BoolArray) -> list[int]:
    """Columns, in servo order, of the joints that do not carry the robot, those farthest from the root first."""
    body, joints = robot.body, robot.joint_map.joints
    depths = [len(body.chain_to_root(body.joint_body[body.joint_index(joint)])) for joint in joints]
    return sorted(np.flatnonzero(~carrying).tolist(), key=lambda column: -depths[column])


RETURN_OVERRIDE = 0.5
"""Speed override of the return to stance: it need not be fast, and dynamic loads on the soles grow with its square."""
LONGEST_RETURN_S = 15.0
"""Longest return to stance, s; then the robot stops, and goes to rest from where it is."""
SETTLE_S = 0.2
"""The robot holds this long after a refusal, s: servos are behind their goals, and the gate checks both."""


class _Part(Enum):
    """A part of the move: return to stance, stop in the middle of that, go to rest."""

    RETURN = 0
    STOP = 1
    REST = 2


class RestTrajectory:
    """The move to posture `rest`, tick by tick of `dt` s.

    First the follower returns the robot to its stance (see `FollowingStage.return_to_stance`), then the robot goes
    straight to rest. Where the gate refuses that, it returns to the stance once more from there. After that it tries
    the other trajectories of `rest_trajectories`, and after the last it holds.
    """

    def __init__(
        self,
        robot: RobotBody,
        follower: FollowingStage,
        *,
        dt: float,
        notify: Notify = lambda text: None,
    ) -> None:
        """notify: receives what fails."""
        self._robot, self._follower, self._dt, self._notify = robot, follower, dt, notify
        self._trajectories = rest_trajectories(robot, dt=dt)
        self._trajectory: Trajectory | None = None
        self._part = _Part.REST
        self._returns = 0
        """Returns to stance that may still begin."""
        self._elapsed = 0.0
        """Time of the current return to stance, s."""
        self._hold_ticks = 0
        """Ticks to hold before going on."""
        self._refused = False
        """Whether the return to stance holds because its goal was refused."""
        self.begun = False
        """Whether the move has begun; it may be over."""
        self._arrived = False

    @property
    def returns_to_stance(self) -> bool:
        """Whether the follower leads the robot: it returns to its stance, or stops on the way there."""
        return self._part is not _Part.REST

    def next(
        self, q: FloatArray, *, passed: bool, stands: bool, returns_to_stance: bool = True, speed_override: float = 1.0
    ) -> FloatArray | None:
        """The next posture (nq,); None: it is at rest, cannot go on, or has to brake first.

        q (nq,): the posture that was sent last; passed: whether that is what was asked for; stands: whether nothing is
        left to brake. returns_to_stance: whether a return to stance comes first, read in the first call only.
        speed_override: of a robot whose servos are warm.
        """
        if not self.begun:
            self.begun, passed = True, True  # there is no earlier goal
            self._returns = 2 if returns_to_stance else 0
            self._begin_return(q)
        if self._hold_ticks > 0:
            self._hold_ticks -= 1
            return self._hold(q)
        there = (
            self._return_to_stance(q, passed=passed, stands=stands, speed_override=speed_override)
            if self._part is _Part.RETURN
            else None
        )
        if there is None and self._part is _Part.STOP:
            there = None if stands else self._follower.halt(self._dt)
            if there is None and not stands:
                return None
            self._part = _Part.REST if stands else _Part.STOP
        return self._go_to_rest(q, passed=passed, stands=stands) if there is None else there

    def _begin_return(self, q: FloatArray) -> None:
        """Begin a return to stance from q (nq,), where the robot stands, if one is left."""
        self._refused, self._elapsed = False, 0.0
        self._part = _Part.RETURN if self._returns > 0 else _Part.REST
        if self._returns > 0:
            self._returns -= 1
            self._call(lambda: self._follower.begin_return_to_stance(q.copy()))

    def _settle(self, q: FloatArray) -> FloatArray:
        """Hold q (nq,) for SETTLE_S."""
        self._hold_ticks = round(SETTLE_S / self._dt) - 1
        return self._hold(q)

    def _hold(self, q: FloatArray) -> FloatArray:
        """Hold q (nq,) for a tick."""
        self._elapsed += self._dt
        self._follower.pass_time(self._dt)
        return q.copy()

    def _try_next(self, q: FloatArray) -> FloatArray:
        """Drop the current trajectory, and hold q (nq,) before the next attempt."""
        self._trajectory = None
        self._begin_return(q)
        return self._settle(q)

    def _return_to_stance(
        self, q: FloatArray, *, passed: bool, stands: bool, speed_override: float
    ) -> FloatArray | None:
        """The next posture (nq,) of the return to stance; None: it is over."""
        if stands and not passed:
            if self._refused:
                return self._try_next(q)
            self._refused = True
            self._call(self._follower.separate_limbs)
            return self._settle(q)
        self._refused &= stands
        self._elapsed += self._dt
        if self._elapsed >= LONGEST_RETURN_S:
            self._abandon_return(f"not there after {LONGEST_RETURN_S:g} s")
            return None

        def step() -> FloatArray | None:
            self._follower.set_speed_override(min(RETURN_OVERRIDE, speed_override))
            return self._follower.return_to_stance(self._dt)

        there = self._call(step)
        if there is None and self._part is _Part.RETURN:
            self._part = _Part.REST
        return there

    def _call(self, call: Callable[[], FloatArray | None]) -> FloatArray | None:
        """The result of a call of the follower; None where it raises."""
        try:
            return call()
        except Exception as error:  # noqa: BLE001 - the robot can go to rest without it
            self._abandon_return(str(error) or type(error).__name__)
            return None

    def _abandon_return(self, reason: str) -> None:
        """Return to stance no more: stop, and go to rest from there."""
        self._returns, self._part = 0, _Part.STOP
        with suppress(OSError):  # a lost terminal must not keep the robot from rest
            self._notify(f"return to stance: {reason}; the robot goes to rest from where it is")

    def _go_to_rest(self, q: FloatArray, *, passed: bool, stands: bool) -> FloatArray | None:
        """The next posture (nq,) of a rest trajectory; None: at rest, none is left, or it has to brake first."""
        if self._arrived:
            return None
        if self._trajectory is not None and not passed:
            if stands:
                return self._try_next(q)
            self._follower.pass_time(self._dt)
            return None
        columns = self._robot.servo_columns
        if self._trajectory is None:
            begin = next(self._trajectories, None)
            if begin is None:
                return None
            self._trajectory = begin(q[columns])
        self._follower.pass_time(self._dt)
        goal = next(self._trajectory, None)
        if goal is None:
            self._arrived = True
            return None
        there = q.copy()
        there[columns] = goal
        plant_root(self._robot, q, there)
        return there
