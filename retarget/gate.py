"""The gate: the last word on a goal. Nothing passes that is not finite, inside every limit, and able to stop within
them."""

from collections.abc import Callable

import numpy as np

from hardware.arrays import FloatArray
from hardware.errors import HardwareError, describe
from hardware.joint_map import JointMap
from retarget._solver import frame_bounds

PathCheck = Callable[[FloatArray, FloatArray], bool]
"""From two paths of postures, rad (k, n), a tick from row to row, first row present, last row at rest: that of the goal
and that followed if it is refused; to whether all of the first is clear of collision."""

ROUND_OFF = 1e-9
"""How far, in rad, a goal may miss a bound before it counts as a refusal: two programs that agree differ by less."""


class Gate:
    """A `hardware.goal_filter.GoalFilter`. Postures are joint radians (n,) in the profile's servo order; one call per
    tick of `dt` s.

    A goal passes whole or not at all: a posture in which some joints brake and others go on was never asked for by
    anybody. Limits are judged on radians, before goals are rounded to ticks (one tick of 1.5 mrad in 8 ms would alone
    be 24 rad/s^2).

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
        self._lower = np.array(lower, dtype=np.float64)  # (n,) [rad]
        self._upper = np.array(upper, dtype=np.float64)
        self._max_velocity = np.array(max_velocity, dtype=np.float64)  # (n,) [rad/s]
        self._max_acceleration = np.array(max_acceleration, dtype=np.float64)  # (n,) [rad/s^2]
        self._dt = float(dt)
        self._step = self._max_velocity * dt  # (n,) largest displacement of one tick [rad]
        self._change = self._max_acceleration * dt**2  # (n,) largest change of displacement between ticks [rad]
        self._path_is_clear = path_is_clear
        limits = np.stack([self._lower, self._upper, self._step, self._change])
        if not (np.isfinite(limits).all() and (self._lower < self._upper).all() and (limits[2:] > 0.0).all()):
            raise HardwareError(
                describe(
                    what="needs finite limits in ascending order and positive rates",
                    where="gate",
                    then="Correct the profile",
                )
            )
        # Ticks that the fastest joint needs to stand, and one for the goal itself.
        rows = 2 + int(np.ceil((self._step / self._change).max()))
        self._slowing = np.arange(rows)[:, None] * self._change  # (rows, n) what braking takes off a displacement
        self._position = np.zeros_like(self._lower)
        self._displacement = np.zeros_like(self._lower)
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
        if start.shape != self._lower.shape or not np.isfinite(start).all():
            raise HardwareError(
                describe(
                    what="cannot start from this posture",
                    where="gate",
                    found=start,
                    allowed=f"{self._lower.size} finite joint angles",
                    then="Check that every servo answers",
                )
            )
        self._position = start
        self._displacement = np.zeros_like(start)
        self._looked_at = None

    def passes(self, goal: FloatArray) -> bool:
        """Whether `admit` would send just this goal, rad (n,), now."""
        self._looked_at = np.array(goal, dtype=np.float64), self._admitted(np.asarray(goal, dtype=np.float64))
        return self._looked_at[1] is not None

    def nearest(self, goal: FloatArray) -> FloatArray:
        """The posture nearest to a finite `goal` that keeps the limits, rad (n,), clear or not; joint by joint."""
        lo, hi = self._bounds(self._braked(self._displacement))
        return np.minimum(np.maximum(goal, self._position + lo), self._position + hi)

    def admit(self, goal: FloatArray) -> FloatArray:
        """Return the posture to send for `goal`, rad (n,): the goal itself or, refused, the next one of the braking
        trajectory."""
        known, self._looked_at = self._looked_at, None
        if known is not None and np.array_equal(known[0], goal):
            displacement = known[1]
        else:
            displacement = self._admitted(np.asarray(goal, dtype=np.float64))
        if displacement is None:
            return self.brake()
        self._advance(displacement)
        # The goal to the bit: a difference of rounding would be asked for again in the next tick, and grow.
        self._position = np.array(goal, dtype=np.float64)
        return self._position.copy()

    def brake(self) -> FloatArray:
        """Return the next posture of the last verified braking trajectory, rad (n,)."""
        return self._advance(self._braked(self._displacement))

    def _admitted(self, goal: FloatArray) -> FloatArray | None:
        """Displacement to a goal that passes, (n,); None for one that is refused."""
        if goal.shape != self._position.shape or not np.isfinite(goal).all():
            return None
        lo, hi = self._bounds(self._braked(self._displacement))
        asked = goal - self._position
        if np.maximum(lo - asked, asked - hi).max() > ROUND_OFF:
            return None
        admitted = np.minimum(np.maximum(asked, lo), hi)
        if self._path_is_clear is not None:
            instead = self._path(self._braked(self._displacement))
            if not self._path_is_clear(self._path(admitted), instead):
                return None
        return admitted

    def _bounds(self, braked: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Displacements that leave a braking trajectory, (n,) each. To go on braking is always among them, beyond a
        limit too."""
        lo, hi = frame_bounds(
            self._position,
            self._displacement,
            self._lower,
            self._upper,
            self._max_velocity,
            self._max_acceleration,
            self._dt,
        )
        return np.minimum(lo, braked), np.maximum(hi, braked)

    def _braked(self, displacement: FloatArray) -> FloatArray:
        """The next displacement under full deceleration, (n,)."""
        slower: FloatArray = np.maximum(np.abs(displacement) - self._change, 0.0)
        return np.copysign(slower, displacement)

    def _advance(self, displacement: FloatArray) -> FloatArray:
        self._looked_at = None
        self._position = self._position + displacement
        self._displacement = displacement
        return self._position.copy()

    def _path(self, displacement: FloatArray) -> FloatArray:
        """Postures from the present one through `displacement` to rest, (rows, n); the last rows may repeat."""
        slower = np.maximum(np.abs(displacement) - self._slowing, 0.0)
        path = np.zeros((len(self._slowing) + 1, self._position.size))
        np.cumsum(np.copysign(slower, displacement), axis=0, out=path[1:])
        path += self._position
        return path
