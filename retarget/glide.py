"""A point that goes to a goal which may leap, with bounded speed and acceleration along each axis, and stops there."""

from collections.abc import Sequence
from math import copysign

from retarget.pursuit import braking_displacement

__all__ = ["Glide"]


class Glide:
    """`at`: where the point is, m; `moved`: how far it went in the last tick, m. It starts at rest."""

    def __init__(self, at: Sequence[float], *, acceleration: float, speed: float) -> None:
        """acceleration, m/s^2, and speed, m/s: the most along each axis."""
        self._acceleration, self._speed = acceleration, speed
        self.restart(at)

    def restart(self, at: Sequence[float], moved: Sequence[float] | None = None) -> None:
        """Go on from a point. moved: how far it went in the last tick, m; absent: it rests there."""
        self.at = [float(value) for value in at]
        self.moved = [0.0] * len(self.at) if moved is None else [float(value) for value in moved]

    def step(self, goal: Sequence[float], dt: float, *, haste: float = 1.0) -> list[float]:
        """Where it is `dt` s later, on its way to a goal. haste: share of its speed."""
        change, most = self._acceleration * dt * dt, haste * self._speed * dt
        for axis, (at, moved) in enumerate(zip(self.at, self.moved, strict=True)):
            gap = goal[axis] - at
            wanted = copysign(min(braking_displacement(abs(gap), change), most), gap)
            moved = min(max(wanted, moved - change), moved + change)
            self.at[axis], self.moved[axis] = at + moved, moved
        return self.at
