"""The gate: the last check of a goal. A goal passes if it is finite, within every limit, and can stop within them."""

from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

import numpy as np

from hardware.arrays import FloatArray
from hardware.errors import HardwareError, describe
from hardware.guard import CheckedGoal, _Seal
from hardware.joint_map import JointMap
from retarget._solver import Braking
from retarget.safety.clearance import PathClearance

ROUND_OFF = 1e-9
"""Angle, rad, by which a goal may miss a bound before the gate refuses it: rounding of two programs that agree is
less."""


class Compensated(Protocol):
    """The offset of a goal from the posture in which it holds the joints; (n,) rad."""

    @property
    def posture(self) -> FloatArray:
        """The posture."""
        ...

    @property
    def offset(self) -> FloatArray:
        """The offset of the goal."""
        ...

    @property
    def moved(self) -> FloatArray:
        """The change of the offset in this tick, as far as it goes on in braking."""
        ...


class Compensation(Protocol):
    """Offsets goals from postures. It keeps nothing between two goals: `last` is what was compensated in the goal sent
    last."""

    def begin(self, posture: FloatArray) -> Compensated:
        """No offset, in a posture, rad (n,)."""
        ...

    def propose(
        self, last: Any, posture: FloatArray, nearest: Callable[[FloatArray], FloatArray]
    ) -> tuple[FloatArray, Compensated]:
        """The goal (n,) rad for a posture (n,), rad. nearest: the goal within the gate's limits that is nearest to
        one."""
        ...

    def brake(self, last: Any, goal: FloatArray, moved: FloatArray) -> Compensated:
        """A goal, rad (n,), of a robot that brakes, whose offset changes by `moved`, (n,)."""
        ...


class Gate:
    """Makes every `CheckedGoal` of a robot. Postures are joint radians (n,) in the profile's servo order; one goal per
    tick of `dt` s. The gate keeps nothing between two goals: each is made from the one that was sent last.

    A target passes whole or not at all: no caller has asked for a posture in which some joints brake and others go on.
    Limits are checked on radians, before goals are rounded to ticks (one tick of 1.5 mrad in 8 ms would alone be
    24 rad/s^2). clearance: checks paths for collision; None: it is not checked. With `compensation`, limits are
    checked on the goal, and clearance on the posture that it holds.

    All joints brake in proportion, in as many ticks as the slowest needs, so that the robot goes on along its way. The
    braking trajectory follows from positions, velocities and the change of the offset alone: what was verified when a
    goal passed is what `brake` follows.
    """

    def __init__(
        self,
        joint_map: JointMap,
        *,
        dt: float,
        speed: float = 1.0,
        clearance: PathClearance | None = None,
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
        self.clearance, self._compensation = clearance, compensation
        self._size, self._braking = len(joint_map), Braking(*limits, dt=float(dt))
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
        return self._made(CheckedGoal(start, start, np.zeros_like(start), True, compensated, self._seal), None)

    def check(
        self, last: CheckedGoal, target: FloatArray | None, *, standing: FloatArray | None = None
    ) -> CheckedGoal | None:
        """The goal for a target posture, rad (n,), after the goal sent last; None: it is refused, or there is none.
        standing (nq,): as the robot stands, where clearance is checked."""
        if target is None or target.shape != last.joints.shape or not np.isfinite(target).all():
            return None
        target = np.array(target, dtype=np.float64, order="C")
        # First the limits, which cost microseconds, then the sweep for collision, which costs most of a check.
        goal, compensated = target, None
        if self._compensation is not None:
            goal, compensated = self._compensation.propose(last.compensated, target, partial(self._nearest, last))
        displacement = self._admitted(last, goal)
        if displacement is None:
            return None
        if self.clearance is not None:
            assert standing is not None, "collision depends on where the robot stands"
            path, instead = self._paths(last, displacement, goal - target, compensated)
            if not self.clearance(path, instead, standing):
                return None
        # The goal to the bit: a difference of rounding would be asked for again in the next tick, and grow.
        return self._made(CheckedGoal(goal, target, displacement, True, compensated, self._seal), last)

    def at_rest(self, goal: CheckedGoal) -> bool:
        """Return whether a goal can be the last: the joints may stop at it at once."""
        return bool(self._braking.ticks(goal.displacement) <= 1.0)

    def brake(self, last: CheckedGoal) -> CheckedGoal:
        """The next goal of the braking trajectory that was verified with the goal sent last; once at rest, the same
        goal for ever."""
        displacement = self._braking.braked(last.joints, last.displacement)
        posture = goal = last.joints + displacement
        compensated = None
        if self._compensation is not None:
            moved = (1.0 - 1.0 / self._braking.ticks(last.displacement)) * last.compensated.moved
            compensated = self._compensation.brake(last.compensated, goal, moved)
            posture = compensated.posture
        return self._made(CheckedGoal(goal, posture, displacement, False, compensated, self._seal), last)

    def _admitted(self, last: CheckedGoal, goal: FloatArray) -> FloatArray | None:
        """The displacement (n,) to a goal that keeps the limits; None: it does not."""
        return self._braking.admitted(last.joints, last.displacement, goal, tolerance=ROUND_OFF)

    def _nearest(self, last: CheckedGoal, goal: FloatArray) -> FloatArray:
        """The goal nearest to a finite one that keeps the limits, rad (n,), clear or not; joint by joint."""
        # The bounds are on the displacement of this tick.
        lo, hi = self._braking.bounds(last.joints, last.displacement)
        return np.asarray(np.minimum(np.maximum(goal, last.joints + lo), last.joints + hi))

    def _paths(
        self, last: CheckedGoal, displacement: FloatArray, offset: FloatArray, compensated: Compensated | None
    ) -> tuple[FloatArray, FloatArray]:
        """The postures (k, n), rad, on the way to a goal and from there to rest, and those of braking instead. offset
        (n,): of the goal."""
        # Collision is a matter of postures, not of goals: the offset that holds a joint against its load is taken off,
        # which goes on as the joints brake.
        path, instead = self._braking.paths(last.joints, last.displacement, displacement)
        if compensated is not None:
            before = last.compensated.offset
            path[0] -= before
            path[1:] -= offset + self._going_on(displacement, compensated.moved, len(path) - 1)
            instead -= before + self._going_on(last.displacement, last.compensated.moved, len(instead))
        return path, instead

    def _going_on(self, displacement: FloatArray, moved: FloatArray, rows: int) -> FloatArray:
        """How far (rows, n) the offset goes on, tick by tick, beside joints that brake from a displacement (n,): its
        last change was `moved` (n,), rad."""
        left = np.maximum(1.0 - np.arange(rows) / self._braking.ticks(displacement), 0.0)
        left[0] = 0.0
        gone: FloatArray = np.multiply.outer(np.cumsum(left), moved)
        return gone

    def _made(self, goal: CheckedGoal, last: CheckedGoal | None) -> CheckedGoal:
        self._seal.last, self._seal.before = goal, last
        return goal


class PassThroughGate(Gate):
    """A gate without limits: every finite goal passes. For servos that do not exist, to see what a gate would have held
    back. It still brakes within the servos' accelerations."""

    def _admitted(self, last: CheckedGoal, goal: FloatArray) -> FloatArray:
        displacement: FloatArray = goal - last.joints
        return displacement
