"""The gate: the last check of a goal. A goal passes if it is finite and within every limit, and if from there the robot
can stop: within its limits, clear of collision, on its soles."""

from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

import numpy as np

from hardware.arrays import FloatArray
from hardware.errors import HardwareError, describe
from hardware.guard import CheckedGoal, _Seal
from hardware.imu import ImuSample
from hardware.joint_map import JointMap
from retarget._solver import Braking
from retarget.ik.whole_body_stop import StopPath
from retarget.safety.clearance import PathClearance
from retarget.safety.standing import StandingCheck

MOST_OFFSET, OFFSET_SPEED = 0.4, 5.0
"""Most, rad, that a goal of a walking robot may be from its posture, and speed at which that may change, in shares of a
joint's own: a little more than `retarget.robot.walking.walking_goals` asks for."""
ROUND_OFF = 1e-9
"""Angle, rad, by which a goal may miss a bound before the gate refuses it: rounding of two programs that agree is
less."""


class Compensated(Protocol):
    """The offset of a goal from the posture in which it holds the joints."""

    @property
    def forced(self) -> bool:
        """Whether the gate's limits have made of the offset a motion of its own."""
        ...

    @property
    def free(self) -> bool:
        """Whether the offset has bounds of its own, so that the limits are those of the posture alone."""
        ...


class Compensation(Protocol):
    """Offsets goals from postures. It keeps nothing between two goals: `last` is what was compensated in the goal sent
    last."""

    def begin(self, posture: FloatArray) -> Compensated:
        """No offset, in a posture, rad (n,)."""
        ...

    def measure(self, joints: FloatArray, imu: ImuSample | None) -> None:
        """Set what the servos, rad (n,), and the IMU say in this tick."""
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
        """The goal (n,) rad for a posture (n,), rad. nearest: the goal within the gate's limits that is nearest to
        one. ahead (n,): rad, the posture that follows. walks: whether the robot does; None: as before."""
        ...


class Gate:
    """Makes every `CheckedGoal` of a robot. Postures are joint radians (n,) in the profile's servo order; one goal per
    tick of `dt` s. The gate keeps nothing between two goals but what was measured: each is made from the one that was
    sent last.

    A target passes whole or not at all, with the path of its stop: that of its planner, else one on which all joints
    brake in proportion, in as many ticks as the slowest needs. Where no target passes, the next posture of the stop
    that was verified last is sent, so the robot can always stop.

    Limits are checked on radians, before goals are rounded to ticks (one tick of 1.5 mrad in 8 ms would alone be
    24 rad/s^2). clearance: checks paths for collision; None: it is not checked. standing: checks soles and balance on
    the stops of a planner. With `compensation`, goals are offset from postures: the limits of this tick are checked on
    the goal, and all else on postures; an offset changes only as far as the limits let it. The torque of a robot that
    walks comes and goes faster than joints move: there all limits are those of the posture, and the offset is no more
    than MOST_OFFSET.
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
        """joint_map: of the profile's servos, with their limits. speed: share of their greatest velocities that passes.
        Raises HardwareError for limits that are none."""
        velocity = speed * joint_map.max_velocity
        limits = np.array([joint_map.lower, joint_map.upper, velocity, joint_map.max_acceleration])
        if not (np.isfinite(limits).all() and (limits[0] < limits[1]).all() and (limits[2:] > 0.0).all()):
            raise HardwareError(
                describe(
                    what="needs finite limits in ascending order and positive rates",
                    where="gate",
                    then="Correct the profile",
                )
            )
        self.clearance, self.standing, self._compensation = clearance, standing, compensation
        self._size, self._braking = len(joint_map), Braking(*limits, dt=float(dt))
        self._lower, self._upper = limits[:2]
        self._fastest = velocity * float(dt) + ROUND_OFF  # (n,) [rad] in a tick
        self._seal = _Seal()

    def begin(self, position: FloatArray) -> CheckedGoal:
        """Start at rest at the robot's present `position`, rad (n,); beyond a limit a joint may stand or walk back in.
        Raises HardwareError if not finite."""
        start = np.array(position, dtype=np.float64)
        if start.shape != (self._size,) or not np.isfinite(start).all():
            raise HardwareError(
                describe(
                    what="cannot start from this posture",
                    where="gate",
                    found=start,
                    allowed=f"{self._size} finite joint angles",
                    then="Check that every servo answers",
                )
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
        """The goal for a target posture, rad (n,), after the goal sent last; None: it is refused, or there is none.
        stop: how the robot stops from there. standing (nq,): as the robot stands, where more than limits is checked."""
        target = _finite(last, target)
        return None if target is None else self._judged(last, target, stop, standing)

    def _judged(
        self, last: CheckedGoal, target: FloatArray, stop: StopPath | None, standing: FloatArray | None
    ) -> CheckedGoal | None:
        """The goal for a finite target, see `check`."""
        # First the limits, which cost microseconds, then soles and balance, then the sweep, which costs most.
        goal, compensated = target, None
        if self._compensation is not None:
            walks = stop is not None and stop.carries is not None
            ahead = target if stop is None or self.standing is None else self.standing.joints(stop.postures[:2])[-1]
            nearest = partial(self._nearest, last)
            goal, compensated = self._compensation.propose(last.compensated, target, nearest, ahead=ahead, walks=walks)
            if compensated.forced or (compensated.free and not self._bounded(last, goal, target)):
                return None
        free = compensated is not None and compensated.free
        displacement = self._admitted(last.posture, last, target) if free else self._admitted(last.joints, last, goal)
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
        # The goal to the bit: a difference of rounding would be asked for again in the next tick, and grow.
        return self._made(CheckedGoal(goal, target, displacement, rows, True, compensated, self._seal), last)

    def at_rest(self, goal: CheckedGoal) -> bool:
        """Return whether a goal can be the last: its stop is over, and the joints may rest at it at once."""
        return not len(goal.stop) and bool(self._braking.ticks(goal.displacement) <= 1.0)

    def brake(self, last: CheckedGoal) -> CheckedGoal:
        """The next goal of the stop that was verified with the goal sent last; once at rest, the same posture for
        ever."""
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
        """Set what the servos, rad (n,), and the IMU say in this tick."""
        if self._compensation is not None:
            self._compensation.measure(joints, imu)

    def _admitted(self, start: FloatArray, last: CheckedGoal, goal: FloatArray) -> FloatArray | None:
        """The displacement (n,) from where joints were sent last to a goal that keeps the limits; None: it does not."""
        return self._braking.admitted(start, last.displacement, goal, tolerance=ROUND_OFF)

    def _bounded(self, last: CheckedGoal, goal: FloatArray, posture: FloatArray) -> bool:
        """Whether a goal is finite, within the joints' ranges, and its offset from its posture neither too large nor
        too fast after that of the last goal."""
        offset = goal - posture
        inside = (goal >= self._lower - ROUND_OFF) & (goal <= self._upper + ROUND_OFF)
        near = np.abs(offset) <= MOST_OFFSET + ROUND_OFF
        slow = np.abs(offset - (last.joints - last.posture)) <= OFFSET_SPEED * self._fastest
        return bool((inside & near & slow).all())

    def _nearest(self, last: CheckedGoal, goal: FloatArray) -> FloatArray:
        """The goal nearest to a finite one that keeps the limits, rad (n,), clear or not; joint by joint."""
        # The bounds are on the displacement of this tick.
        lo, hi = self._braking.bounds(last.joints, last.displacement)
        return np.asarray(np.minimum(np.maximum(goal, last.joints + lo), last.joints + hi))

    def _stop(self, last: CheckedGoal, target: FloatArray, stop: StopPath | None) -> FloatArray | None:
        """The postures (k, n) after the target on the way to rest, rad; None: they do not keep the limits."""
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
    """A gate without limits: every finite goal passes. For servos that do not exist, to see what a gate would have held
    back. It still brakes within the servos' accelerations."""

    def _judged(
        self, last: CheckedGoal, target: FloatArray, stop: StopPath | None, standing: FloatArray | None
    ) -> CheckedGoal:
        """The goal for a finite target, with its planner's stop."""
        displacement = target - last.joints
        if stop is None or self.standing is None:
            rows = self._braking.stop(target, displacement)
        else:
            rows = self.standing.joints(stop.postures[1:])
        return self._made(CheckedGoal(target, target, displacement, rows, True, None, self._seal), last)


def _finite(last: CheckedGoal, target: FloatArray | None) -> FloatArray | None:
    """A target (n,) rad as the gate keeps it; None: it is none, of another shape, or not finite."""
    if target is None or target.shape != last.joints.shape or not np.isfinite(target).all():
        return None
    return np.array(target, dtype=np.float64, order="C")
