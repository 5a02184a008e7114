"""The gate: the last check of a goal. A goal passes if it is finite, within every limit, and can stop within them."""

from collections.abc import Callable

import numpy as np

from hardware.arrays import FloatArray
from hardware.errors import HardwareError, describe
from hardware.joint_map import JointMap
from retarget._solver import Braking

PathCheck = Callable[[FloatArray, FloatArray], bool]
"""From two paths of postures, rad (k, n), a tick from row to row, first row present, last row at rest: that of the goal
and that followed if it is refused; to whether all of the first is clear of collision."""

ROUND_OFF = 1e-9
"""How far, in rad, a goal may miss a bound before the gate refuses it: rounding of two programs that agree is less."""


class Gate:
    """A `hardware.guard_state.GoalFilter`. Postures are joint radians (n,) in the profile's servo order; one call per
    tick of `dt` s.

    A goal passes whole or not at all: no caller has asked for a posture in which some joints brake and others go on.
    Limits are checked on radians, before goals are rounded to ticks (one tick of 1.5 mrad in 8 ms would alone be
    24 rad/s^2).

    Each joint brakes by its own full deceleration, so the braking trajectory follows from position and velocity alone:
    what was verified when a goal passed is what `brake` follows. After a refusal the caller starts anew from `position`
    and `velocity`.
    """

    def __init__(
        self,
        *,
        lower: FloatArray,
        upper: FloatArray,
        max_velocity: FloatArray,
        max_acceleration: FloatArray,
        dt: float,
        path_is_clear: PathCheck | None = None,
    ) -> None:
        limits = np.array([lower, upper, max_velocity, max_acceleration], dtype=np.float64)
        self._dt = float(dt)
        self._path_is_clear = path_is_clear
        if not (np.isfinite(limits).all() and (limits[0] < limits[1]).all() and (limits[2:] > 0.0).all()):
            raise HardwareError(
                describe(
                    what="needs finite limits in ascending order and positive rates",
                    where="gate",
                    then="Correct the profile",
                )
            )
        self._braking = Braking(*limits, dt=self._dt)
        self._position: FloatArray = np.zeros_like(limits[0])
        self._displacement: FloatArray = np.zeros_like(limits[0])
        self._looked_at: tuple[FloatArray, FloatArray | None] | None = None  # goal and verdict, from here

    @classmethod
    def for_servos(
        cls, joint_map: JointMap, *, dt: float, speed: float = 1.0, path_is_clear: PathCheck | None = None
    ) -> "Gate":
        """Return the gate for the limits of a profile's servos, with control period `dt` s.

        speed: share of the servos' greatest velocities that passes.
        """
        return cls(
            lower=joint_map.lower,
            upper=joint_map.upper,
            max_velocity=speed * joint_map.max_velocity,
            max_acceleration=joint_map.max_acceleration,
            dt=dt,
            path_is_clear=path_is_clear,
        )

    @property
    def position(self) -> FloatArray:
        """Posture returned last, rad (n,); a copy."""
        return self._position.copy()

    @property
    def sent(self) -> FloatArray:
        """The same: goals are postures."""
        return self.position

    @property
    def velocity(self) -> FloatArray:
        """Velocity at which the posture returned last was reached, rad/s (n,)."""
        return self._displacement / self._dt

    @property
    def at_rest(self) -> bool:
        """Whether nothing is left to brake."""
        return not self._displacement.any()

    def seed(self, position: FloatArray) -> None:
        """Start at rest at `position`, rad (n,); beyond a limit a joint may stand or walk back in. Raises HardwareError
        if not finite."""
        start = np.array(position, dtype=np.float64)
        if start.shape != self._position.shape or not np.isfinite(start).all():
            raise HardwareError(
                describe(
                    what="cannot start from this posture",
                    where="gate",
                    found=start,
                    allowed=f"{self._position.size} finite joint angles",
                    then="Check that every servo answers",
                )
            )
        self._position = start
        self._displacement = np.zeros_like(start)
        self._looked_at = None

    def passes(self, goal: FloatArray) -> bool:
        """Whether `admit` would send just this goal, rad (n,), now."""
        goal = np.array(goal, dtype=np.float64, order="C")
        self._looked_at = goal, self._admitted(goal)
        return self._looked_at[1] is not None

    def nearest(self, goal: FloatArray) -> FloatArray:
        """The posture nearest to a finite `goal` that keeps the limits, rad (n,), clear or not; joint by joint."""
        lo, hi = self._braking.bounds(self._position, self._displacement)
        return np.minimum(np.maximum(goal, self._position + lo), self._position + hi)

    def admit(self, goal: FloatArray) -> FloatArray:
        """Return the posture to send for `goal`, rad (n,): the goal itself or, refused, the next one of the braking
        trajectory."""
        goal = np.array(goal, dtype=np.float64, order="C")
        known, self._looked_at = self._looked_at, None
        same = known is not None and known[0].tobytes() == goal.tobytes()
        displacement = known[1] if known is not None and same else self._admitted(goal)
        if displacement is None:
            return self.brake()
        # The goal to the bit: a difference of rounding would be asked for again in the next tick, and grow.
        self._position, self._displacement = goal, displacement
        return goal.copy()

    def brake(self) -> FloatArray:
        """Return the next posture of the last verified braking trajectory, rad (n,)."""
        return self._advance(self._braking.braked(self._displacement))

    def _admitted(self, goal: FloatArray) -> FloatArray | None:
        """Displacement to a goal that passes, (n,); None for one that is refused."""
        if goal.shape != self._position.shape:
            return None
        admitted = self._braking.admitted(self._position, self._displacement, goal, tolerance=ROUND_OFF)
        if admitted is None or self._path_is_clear is None:
            return admitted
        paths = self._braking.paths(self._position, self._displacement, admitted)
        return admitted if self._path_is_clear(*paths) else None

    def _advance(self, displacement: FloatArray) -> FloatArray:
        self._looked_at = None
        self._position = self._position + displacement
        self._displacement = displacement
        return self._position.copy()


# No gate: every finite goal passes. For servos that do not exist, to see what the gate would have held back.


class PassThroughGate:
    """A `hardware.guard_state.GoalFilter` without limits. It still brakes within `max_acceleration` (n,) rad/s^2."""

    def __init__(self, max_acceleration: FloatArray, *, dt: float) -> None:
        self._change = np.asarray(max_acceleration) * dt**2
        self._position = np.zeros_like(self._change)
        self._displacement = np.zeros_like(self._change)

    @property
    def position(self) -> FloatArray:
        """Posture returned last, rad (n,)."""
        return self._position.copy()

    @property
    def sent(self) -> FloatArray:
        """The same: goals are postures."""
        return self.position

    @property
    def at_rest(self) -> bool:
        """Whether nothing is left to brake."""
        return not self._displacement.any()

    def seed(self, position: FloatArray) -> None:
        """Start at rest at `position`, rad (n,). Raises HardwareError if not finite."""
        self._position = self._finite(position)
        self._displacement = np.zeros_like(self._position)

    def admit(self, goal: FloatArray) -> FloatArray:
        """Return `goal`, rad (n,). Raises HardwareError if not finite."""
        goal = self._finite(goal)
        self._displacement = goal - self._position
        self._position = goal
        return goal.copy()

    def brake(self) -> FloatArray:
        """Return the next posture under full deceleration, rad (n,)."""
        slower = np.maximum(np.abs(self._displacement) - self._change, 0.0)
        self._displacement = np.copysign(slower, self._displacement)
        self._position = self._position + self._displacement
        return self._position.copy()

    def _finite(self, posture: FloatArray) -> FloatArray:
        posture = np.array(posture, dtype=np.float64)
        if posture.shape != self._change.shape or not np.isfinite(posture).all():
            raise HardwareError(
                describe(what="a goal that no servo can take", where="no gate", found=posture, allowed="finite angles")
            )
        return posture
