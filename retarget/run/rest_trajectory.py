"""From a stop to rest: to a stance first, then along a rest trajectory, around what is in the way."""

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
from retarget.types import BoolArray, FloatArray

__all__ = [
    "ALONE_RAD",
    "LONGEST_TO_REST_S",
    "NEAR_REST",
    "REST_WITHIN_S",
    "RestTrajectory",
    "Way",
    "not_at_rest",
    "rest_trajectories",
]


# The ways of a robot that stands to where it is parked: straight, and around what is in the way.

Way = Iterator[FloatArray]
"""Goals (n,) rad, a tick from one to the next."""
REST_WITHIN_S = 2.5
"""So long the straight way takes at most, and each part of one around something; it goes as fast as that asks."""
ALONE_RAD = 0.3
"""So far a joint goes aside alone, before all the arm does."""
LONGEST_TO_REST_S = 45.0
"""So long all of it takes at most, s; then its torque goes off where it is."""
NEAR_REST = 0.2
"""A robot is parked when no joint is farther than this from posture `rest`, rad."""


def rest_trajectories(robot: RobotBody, *, dt: float) -> Iterator[Callable[[FloatArray], Way]]:
    """Ways to the profile's rest posture, one after the other, each from where the robot stands then, (n,) rad.

    First straight there. Then the arms aside, legs still; the whole robot to `stand`, and straight down from there.
    Arms are aside as in `attractor`; if that is not to be had either, as in `stand`, then as in `neutral`. Then joint
    by joint, the outermost first: one joint of an arm alone goes aside, then the rest as before - what keeps a hand off
    its own forearm may be a wrist that goes first.
    """
    columns, postures = robot.servo_columns, robot.profile.postures
    attractor, stand, neutral, rest = (
        robot.posture(posture)[columns]
        for posture in (postures.attractor, postures.stand, postures.neutral, postures.rest)
    )
    joints = [robot.body.dof_index(joint) for joint in robot.joint_map.joints]
    carrying = standing_dofs(robot)[joints]

    def through(here: FloatArray, places: Iterable[FloatArray]) -> Way:
        speed, within = robot.profile.safety.speed_caps.approach, REST_WITHIN_S - dt
        for place in places:
            yield from approach(here, place, robot.joint_map, speed=speed, dt=dt, within=within)
            here = place

    def by(aside: FloatArray, alone: int | None, here: FloatArray) -> Way:
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
    """What is to be told of a robot on its soles whose torque went off with `joints` (n,) rad, servo order, though it
    was to be parked and nothing else stopped it."""
    if not robot.stands or (stop is not None and (stop.cause not in GOING_TO_REST or stop.then is not None)):
        return ()
    off = np.abs(joints - robot.posture(robot.profile.postures.rest)[robot.servo_columns])
    worst = int(off.argmax())
    if off[worst] <= NEAR_REST:
        return ()
    where = f"{robot.joint_map.joints[worst]} {off[worst]:.2f} rad from it"
    return (f"not parked: no way to posture rest was found in time; torque went off with {where}",)


def _outermost(robot: RobotBody, carrying: BoolArray) -> list[int]:
    """Columns, in servo order, of the joints that do not carry the robot, those farthest from the root first."""
    body, joints = robot.body, robot.joint_map.joints
    depths = [len(body.chain_to_root(body.joint_body[body.joint_index(joint)])) for joint in joints]
    return sorted(np.flatnonzero(~carrying).tolist(), key=lambda column: -depths[column])


PACE = 0.5
"""Share of all speeds at which the follower brings the robot to a stand: nobody waits for it, and what its mass does to
the soles goes with the square."""
LONGEST_RETURN_S = 15.0
"""After so long (s) on its way to a stand it stops, and goes home from where it is."""
SETTLE_S = 0.2
"""So long (s) it stands after a refusal: servos are behind their goals, and the gate looks at both."""


class _Part(Enum):
    """Of the way: to a stand, to a stop in the midst of that, home."""

    LANDS = 0
    STOPS = 1
    GOES = 2


class RestTrajectory:
    """One way to posture `rest`, tick by tick of `dt` s.

    First the follower brings the robot to a stand (see `landing`), then it goes straight home. Where something is in
    the way, it goes to a stand once more from there. After that come the other ways of `rest_trajectories`, and after
    the last it stays.
    """

    def __init__(
        self,
        robot: RobotBody,
        follower: FollowingStage,
        *,
        dt: float,
        notify: Callable[[str], object] = lambda text: None,
    ) -> None:
        """tell: hears of what fails on the way."""
        self._robot, self._follower, self._dt, self._notify = robot, follower, dt, notify
        self._ways = rest_trajectories(robot, dt=dt)
        self._way: Way | None = None
        self._part = _Part.GOES
        self._returns = 0
        """That may still begin."""
        self._lasted = 0.0
        """s of the landing at hand."""
        self._waits = 0
        """Ticks that it stands before it goes on."""
        self._refused = False
        """Whether a landing stands because it was refused."""
        self.begun = False
        """Whether the robot has set off, and perhaps arrived."""
        self._arrived = False

    @property
    def returns_to_stance(self) -> bool:
        """Whether it is the follower that leads."""
        return self._part is not _Part.GOES

    def next(
        self, q: FloatArray, *, passed: bool, stands: bool, returns_to_stance: bool = True, slow: float = 1.0
    ) -> FloatArray | None:
        """The next posture (nq,); None: it is there, cannot go on, or has to come to a stand first.

        q (nq,): where the robot was sent last; passed: whether that is what was asked for; stands: whether nothing is
        left to brake. lands: whether it goes to a stand first, asked once, when it stands. slow: share of speed that is
        left to a warm robot.
        """
        if not self.begun:
            self.begun, passed = True, True  # nothing was asked for yet
            self._returns = 2 if returns_to_stance else 0
            self._land(q)
        if self._waits > 0:
            self._waits -= 1
            return self._stood(q)
        there = self._landed(q, passed=passed, stands=stands, slow=slow) if self._part is _Part.LANDS else None
        if there is None and self._part is _Part.STOPS:
            there = None if stands else self._follower.halt(self._dt)
            if there is None and not stands:
                return None
            self._part = _Part.GOES if stands else _Part.STOPS
        return self._gone(q, passed=passed, stands=stands) if there is None else there

    def _land(self, q: FloatArray) -> None:
        """Begin a landing from where it stands (nq,), if one is left."""
        self._refused, self._lasted = False, 0.0
        self._part = _Part.LANDS if self._returns > 0 else _Part.GOES
        if self._returns > 0:
            self._returns -= 1
            self._tried(lambda: self._follower.begin_return_to_stance(q.copy()))

    def _wait(self, q: FloatArray) -> FloatArray:
        """Where it stands (nq,), from here on."""
        self._waits = round(SETTLE_S / self._dt) - 1
        return self._stood(q)

    def _stood(self, q: FloatArray) -> FloatArray:
        """Where it stands (nq,), for a tick."""
        self._lasted += self._dt
        self._follower.pass_time(self._dt)
        return q.copy()

    def _blocked(self, q: FloatArray) -> FloatArray:
        """Where it stands (nq,): the way at hand is none."""
        self._way = None
        self._land(q)
        return self._wait(q)

    def _landed(self, q: FloatArray, *, passed: bool, stands: bool, slow: float) -> FloatArray | None:
        """The next posture (nq,) of a landing; None: it is over."""
        if stands and not passed:
            if self._refused:
                return self._blocked(q)
            self._refused = True
            self._tried(self._follower.separate_limbs)
            return self._wait(q)
        self._refused &= stands
        self._lasted += self._dt
        if self._lasted >= LONGEST_RETURN_S:
            self._give_up(f"not there after {LONGEST_RETURN_S:g} s")
            return None

        def return_to_stance() -> FloatArray | None:
            self._follower.set_speed_override(min(PACE, slow))
            return self._follower.return_to_stance(self._dt)

        there = self._tried(return_to_stance)
        if there is None and self._part is _Part.LANDS:
            self._part = _Part.GOES
        return there

    def _tried(self, call: Callable[[], FloatArray | None]) -> FloatArray | None:
        """What the follower says; None where it fails."""
        try:
            return call()
        except Exception as error:  # noqa: BLE001 - without it the robot can still go home
            self._give_up(str(error) or type(error).__name__)
            return None

    def _give_up(self, reason: str) -> None:
        """Land no more: stop, and go home from there."""
        self._returns, self._part = 0, _Part.STOPS
        with suppress(OSError):  # who hears nothing any more does not hinder it
            self._notify(f"on its way to a stand: {reason}; it goes home from where it is")

    def _gone(self, q: FloatArray, *, passed: bool, stands: bool) -> FloatArray | None:
        """The next posture (nq,) of a way home; None: it is there, there are no more ways, or something is in it."""
        if self._arrived:
            return None
        if self._way is not None and not passed:
            if stands:
                return self._blocked(q)
            self._follower.pass_time(self._dt)
            return None
        columns = self._robot.servo_columns
        if self._way is None:
            begin = next(self._ways, None)
            if begin is None:
                return None
            self._way = begin(q[columns])
        self._follower.pass_time(self._dt)
        goal = next(self._way, None)
        if goal is None:
            self._arrived = True
            return None
        there = q.copy()
        there[columns] = goal
        plant_root(self._robot, q, there)
        return there
