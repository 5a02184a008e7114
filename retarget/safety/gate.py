"""The gate: the last check of a goal.

A goal passes if it is finite and within every limit, and if the robot can stop from there: within its limits, clear of
collision, on its soles.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

import numpy as np

from hardware.arrays import FloatArray
from hardware.errors import HardwareError
from hardware.guard import CheckedGoal, _Seal
from hardware.imu import ImuSample
from hardware.joint_map import JointMap
from retarget._solver import Braking
from retarget.ik.whole_body_stop import StopPath
from retarget.safety.clearance import PathClearance
from retarget.safety.standing import StandingCheck

MOST_OFFSET, OFFSET_SPEED = 0.4, 5.0
"""[rad] Largest offset of a walking robot's goal, and its speed as a multiple of the joint's; more than
`retarget.robot.walking.walking_goals` uses."""
ROUND_OFF = 1e-9
"""[rad] Tolerance of a bound, more than the rounding of two programs that agree."""


class Compensated(Protocol):
    """The offset of a goal from its posture."""

    @property
    def forced(self) -> bool:
        """True if the limits turned the offset into a motion of its own."""
        ...

    @property
    def free(self) -> bool:
        """True if the offset has bounds of its own, and the limits apply to the posture."""
        ...


class Compensation(Protocol):
    """Offsets goals from postures."""

    def begin(self, posture: FloatArray) -> Compensated:
        """The zero offset of a posture (n,) rad."""
        ...

    def measure(self, joints: FloatArray, imu: ImuSample | None) -> None:
        """Set the joint positions (n,) rad and the IMU sample."""
        ...

    def propose(
        self,
        last: Any,
        posture: FloatArray,
        nearest: Callable[[FloatArray], FloatArray],
        *,
        ahead: FloatArray,
        walks: bool | None,
    ) -> tuple[FloatArray, Compensated]:
        """The goal (n,) rad for a posture (n,) rad.

        last: of the goal sent last. nearest: maps a goal into the limits. ahead (n,): the next posture, rad. walks:
        None if as before.
        """
        ...


class Gate:
    """Makes every `CheckedGoal` of a robot, one per tick. Postures are joint positions (n,) rad, servo order.

    A target passes whole or not at all, with the path of its stop: that of its planner, else one on which all joints
    brake in proportion. After a refusal the next posture of the last verified stop is sent, so the robot can always
    stop.

    Limits are checked in rad: one tick of 1.5 mrad in 8 ms would be 24 rad/s^2. With `compensation` the limits of this
    tick apply to the goal, and all other checks to the posture. The torque of a walking robot changes faster than its
    joints move: then all limits apply to the posture, and the offset is at most MOST_OFFSET.
    """

    def __init__(
        self,
        joint_map: JointMap,
        *,
        dt: float,
        speed: float = 1.0,
        clearance: PathClearance | None = None,
        standing: StandingCheck | None = None,
        compensation: Compensation | None = None,
    ) -> None:
        """speed: share of the greatest velocities. standing: checks planned stops. Raises HardwareError for impossible
        limits."""
        velocity = speed * joint_map.max_velocity
        limits = np.array([joint_map.lower, joint_map.upper, velocity, joint_map.max_acceleration])
        if not (np.isfinite(limits).all() and (limits[0] < limits[1]).all() and (limits[2:] > 0.0).all()):
            what = "needs finite limits in ascending order and positive rates"
            raise HardwareError(what, where="gate", then="Correct the profile")
        self.clearance, self.standing, self._compensation = clearance, standing, compensation
        self._size, self._braking = len(joint_map), Braking(*limits, dt=float(dt))
        self._lower, self._upper = limits[:2]
        self._fastest = velocity * float(dt) + ROUND_OFF  # (n,) [rad] in a tick
        self._seal = _Seal()

    def begin(self, position: FloatArray) -> CheckedGoal:
        """Start at rest at `position` (n,) rad. A joint beyond a limit may return. Raises HardwareError if not
        finite."""
        start = np.array(position, dtype=np.float64)
        if start.shape != (self._size,) or not np.isfinite(start).all():
            raise HardwareError(
                "cannot start from this posture",
                where="gate",
                found=start,
                allowed=f"{self._size} finite joint angles",
                then="Check that every servo answers",
            )
        compensated = None if self._compensation is None else self._compensation.begin(start)
        still, stop = np.zeros_like(start), np.zeros((0, self._size))
        return self._made(CheckedGoal(start, start, still, stop, True, compensated, self._seal), None)

    def check(
        self,
        last: CheckedGoal,
        target: FloatArray | None,
        *,
        stop: StopPath | None = None,
        standing: FloatArray | None = None,
    ) -> CheckedGoal | None:
        """The goal for a target posture (n,) rad after the goal sent last; None if refused. stop: planned from the
        target, its first posture. standing (nq,): the present posture, for collision and balance."""
        if target is None or target.shape != last.joints.shape or not np.isfinite(target).all():
            return None
        return self._judged(last, np.array(target, dtype=np.float64, order="C"), stop, standing)

    def _judged(
        self, last: CheckedGoal, target: FloatArray, stop: StopPath | None, standing: FloatArray | None
    ) -> CheckedGoal | None:
        # The limits cost microseconds, so they come first; the sweep costs most.
        goal, compensated = target, None
        if self._compensation is not None:
            walks = stop is not None and stop.carries is not None
            ahead = target if stop is None or self.standing is None else self.standing.joints(stop.postures[:2])[-1]
            nearest = partial(self._nearest, last)
            goal, compensated = self._compensation.propose(last.compensated, target, nearest, ahead=ahead, walks=walks)
            if compensated.forced or (compensated.free and not self._bounded(last, goal, target)):
                return None
        free = compensated is not None and compensated.free
        start, end = (last.posture, target) if free else (last.joints, goal)
        displacement = self._braking.accepted(start, last.displacement, end, tolerance=ROUND_OFF)
        rows = None if displacement is None else self._stop(last, target, stop)
        if displacement is None or rows is None:
            return None
        if stop is not None and self.standing is not None:
            assert standing is not None, "soles and balance depend on where the robot stands"
            if not self.standing.holds(stop, last.stop, standing):
                return None
        if self.clearance is not None:
            assert standing is not None, "collision depends on where the robot stands"
            path, instead = np.vstack([last.posture, target, rows]), np.vstack([last.posture, last.stop])
            if not self.clearance(path, instead, standing, walk=stop):
                return None
        # The goal to the bit: a difference of rounding would return in the next tick, and grow.
        return self._made(CheckedGoal(goal, target, displacement, rows, True, compensated, self._seal), last)

    def at_rest(self, goal: CheckedGoal) -> bool:
        """True if a goal can be the last: its stop is over, and the joints may rest at once."""
        return not len(goal.stop) and bool(self._braking.ticks(goal.displacement) <= 1.0)

    def brake(self, last: CheckedGoal) -> CheckedGoal:
        """The next goal of the verified stop; at rest the same posture."""
        posture, stop = (last.stop[0], last.stop[1:]) if len(last.stop) else (last.posture, last.stop)
        goal, compensated = posture, None
        if self._compensation is not None:
            nearest, ahead = partial(self._nearest, last), stop[0] if len(stop) else posture
            goal, compensated = self._compensation.propose(last.compensated, posture, nearest, ahead=ahead, walks=None)
        if not np.isfinite(goal).all():  # what was measured is not
            goal, compensated = posture + (last.joints - last.posture), last.compensated
        if compensated is not None and compensated.free and self._bounded(last, goal, posture):
            displacement = posture - last.posture
        else:
            goal = self._nearest(last, goal)
            displacement = goal - last.joints
        return self._made(CheckedGoal(goal, posture, displacement, stop, False, compensated, self._seal), last)

    def measure(self, joints: FloatArray, imu: ImuSample | None) -> None:
        """Set the joint positions (n,) rad and the IMU sample."""
        if self._compensation is not None:
            self._compensation.measure(joints, imu)

    def _bounded(self, last: CheckedGoal, goal: FloatArray, posture: FloatArray) -> bool:
        offset = goal - posture
        inside = (goal >= self._lower - ROUND_OFF) & (goal <= self._upper + ROUND_OFF)
        near = np.abs(offset) <= MOST_OFFSET + ROUND_OFF
        slow = np.abs(offset - (last.joints - last.posture)) <= OFFSET_SPEED * self._fastest
        return bool((inside & near & slow).all())

    def _nearest(self, last: CheckedGoal, goal: FloatArray) -> FloatArray:
        """The nearest goal (n,) rad within the limits."""
        # The bounds are on the displacement of this tick.
        lo, hi = self._braking.bounds(last.joints, last.displacement)
        return np.asarray(np.minimum(np.maximum(goal, last.joints + lo), last.joints + hi))

    def _stop(self, last: CheckedGoal, target: FloatArray, stop: StopPath | None) -> FloatArray | None:
        displacement = target - last.posture
        if (np.abs(displacement) > self._fastest).any():
            return None
        if stop is None:
            return self._braking.stop(target, displacement)
        assert self.standing is not None, "a gate that takes a planner's stops knows the robot"
        joints = self.standing.joints(stop.postures)
        if not np.array_equal(joints[0], target):
            return None
        moves = np.flatnonzero((joints[1:] != joints[:-1]).any(axis=1))
        rows = joints[1 : 2 + moves[-1]] if moves.size else joints[:0]  # a part of two stops ends with the shorter one
        return rows if self._braking.keeps(target, displacement, rows, tolerance=ROUND_OFF) else None

    def _made(self, goal: CheckedGoal, last: CheckedGoal | None) -> CheckedGoal:
        self._seal.last, self._seal.before = goal, last
        return goal


class PassThroughGate(Gate):
    """A gate without limits, for simulated servos. It still brakes."""

    def _judged(
        self, last: CheckedGoal, target: FloatArray, stop: StopPath | None, standing: FloatArray | None
    ) -> CheckedGoal:
        displacement = target - last.joints
        if stop is None or self.standing is None:
            rows = self._braking.stop(target, displacement)
        else:
            rows = self.standing.joints(stop.postures[1:])
        return self._made(CheckedGoal(target, target, displacement, rows, True, None, self._seal), last)
