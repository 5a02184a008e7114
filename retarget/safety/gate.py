"""The gate: the last check of a goal. A goal passes if it is finite, within every limit, and can stop within them."""

from collections.abc import Callable
from typing import Protocol

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


class Compensation(Protocol):
    """How far goals are offset from the postures in which they hold the joints, (n,) rad."""

    @property
    def offset(self) -> FloatArray:
        """The offset of the goal sent last, rad (n,)."""
        ...

    def begin(self, posture: FloatArray) -> None:
        """Begin without an offset in a posture, rad (n,)."""
        ...

    def propose(
        self, posture: FloatArray, nearest: Callable[[FloatArray], FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """The goal (n,) for a posture (n,), rad, and how much of the change of its offset goes on in braking, rad (n,).
        nearest: the goal within the gate's limits that is nearest to one."""
        ...

    def accept(self) -> None:
        """The goal proposed last was passed."""
        ...

    def brake(self, goal: FloatArray, change: FloatArray) -> FloatArray:
        """The posture that a goal holds, rad (n,), of a robot that brakes, whose offset changes by `change`, (n,)."""
        ...


class Gate:
    """Makes every `CheckedGoal` of a robot. Postures are joint radians (n,) in the profile's servo order; one goal per
    tick of `dt` s.

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
        self._braking = Braking(*limits, dt=float(dt))
        self._joints, self._offset_change = np.zeros_like(limits[0]), np.zeros_like(limits[0])  # sent last
        self.displacement = np.zeros_like(limits[0])
        """Of the last tick, rad (n,): what is left to brake."""
        self._seal = _Seal()
        self.goal: CheckedGoal | None = None
        """The goal made last; None before `begin`."""

    def begin(self, position: FloatArray) -> CheckedGoal:
        """Start at rest at the robot's present `position`, rad (n,); beyond a limit a joint may stand or walk back in.
        Raises HardwareError if not finite."""
        start = np.array(position, dtype=np.float64)
        if start.shape != self._joints.shape or not np.isfinite(start).all():
            raise HardwareError(
                describe(
                    what="cannot start from this posture",
                    where="gate",
                    found=start,
                    allowed=f"{self._joints.size} finite joint angles",
                    then="Check that every servo answers",
                )
            )
        if self._compensation is not None:
            self._compensation.begin(start)
        self._joints, self.displacement, self._offset_change = start, np.zeros_like(start), np.zeros_like(start)
        return self._make(start, passed=True)

    def check(self, target: FloatArray | None) -> CheckedGoal | None:
        """The goal for a target posture, rad (n,); None: it is refused, or there is none, and nothing has changed."""
        if target is None or target.shape != self._joints.shape or not np.isfinite(target).all():
            return None
        target = np.array(target, dtype=np.float64, order="C")
        compensation = self._compensation
        # First the limits, which cost microseconds, then the sweep for collision, which costs most of a check.
        goal, change = target, self._offset_change
        if compensation is not None:
            goal, change = compensation.propose(target, self._nearest)
        displacement = self._admitted(goal)
        if displacement is None or not self._is_clear(displacement, goal - target, change):
            return None
        if compensation is not None:
            self._offset_change = change
            compensation.accept()
        # The goal to the bit: a difference of rounding would be asked for again in the next tick, and grow.
        self._joints, self.displacement = goal, displacement
        return self._make(target, passed=True)

    @property
    def at_rest(self) -> bool:
        """Whether the goal that was made last can be the last: the joints may stop at it at once."""
        return bool(self._braking.ticks(self.displacement) <= 1.0)

    def brake(self) -> CheckedGoal:
        """The next goal of the last verified braking trajectory; once at rest, the same goal for ever."""
        self._offset_change = (1.0 - 1.0 / self._braking.ticks(self.displacement)) * self._offset_change
        self.displacement = self._braking.braked(self._joints, self.displacement)
        self._joints = self._joints + self.displacement
        posture = self._joints
        if self._compensation is not None:
            posture = self._compensation.brake(posture, self._offset_change)
        return self._make(posture, passed=False)

    def _admitted(self, goal: FloatArray) -> FloatArray | None:
        """The displacement (n,) to a goal that keeps the limits; None: it does not."""
        return self._braking.admitted(self._joints, self.displacement, goal, tolerance=ROUND_OFF)

    def _nearest(self, goal: FloatArray) -> FloatArray:
        """The goal nearest to a finite one that keeps the limits, rad (n,), clear or not; joint by joint."""
        # The bounds are on the displacement of this tick.
        lo, hi = self._braking.bounds(self._joints, self.displacement)
        return np.asarray(np.minimum(np.maximum(goal, self._joints + lo), self._joints + hi))

    def _is_clear(self, displacement: FloatArray, offset: FloatArray, change: FloatArray) -> bool:
        """Whether the postures are clear on the way to a goal and from there to rest. offset (n,): of the goal; change
        (n,): of it, that goes on."""
        if self.clearance is None:
            return True
        # Collision is a matter of postures, not of goals: the offset that holds a joint against its load is taken off,
        # which goes on as the joints brake.
        path, instead = self._braking.paths(self._joints, self.displacement, displacement)
        if self._compensation is not None:
            before = self._compensation.offset
            path[0] -= before
            path[1:] -= offset + self._going_on(displacement, change, len(path) - 1)
            instead -= before + self._going_on(self.displacement, self._offset_change, len(instead))
        return self.clearance(path, instead)

    def _going_on(self, displacement: FloatArray, change: FloatArray, rows: int) -> FloatArray:
        """How far (rows, n) the offset goes on, tick by tick, beside joints that brake from a displacement (n,): its
        last change was `change` (n,), rad."""
        left = np.maximum(1.0 - np.arange(rows) / self._braking.ticks(displacement), 0.0)
        left[0] = 0.0
        gone: FloatArray = np.multiply.outer(np.cumsum(left), change)
        return gone

    def _make(self, posture: FloatArray, *, passed: bool) -> CheckedGoal:
        self.goal = self._seal.last = CheckedGoal(self._joints.copy(), posture.copy(), passed, self._seal)
        return self.goal


class PassThroughGate(Gate):
    """A gate without limits: every finite goal passes. For servos that do not exist, to see what a gate would have held
    back. It still brakes within the servos' accelerations."""

    def _admitted(self, goal: FloatArray) -> FloatArray:
        displacement: FloatArray = goal - self._joints
        return displacement
