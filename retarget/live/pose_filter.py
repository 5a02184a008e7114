"""Smooth poses: the One-Euro filter (Casiez, Roussel and Vogel, CHI 2012) on positions and turns, by their own times.

A low-pass filter of first order whose cutoff rises with the speed: it smooths what stands and follows what moves. The
speed is the norm of the whole vector, so that turning the world turns the result and changes nothing else. A turn is
filtered as the rotation vector from the filtered orientation to the new one, seen from the world, never as that of the
orientation itself, which leaps at 180 degrees. So the signs of quaternions say nothing.
"""

import numpy as np

from retarget import _solver
from retarget.frames import BoolArray
from retarget.live.one_euro import OneEuroSettings
from retarget.rotations import FloatArray

__all__ = ["PoseFilter"]


class PoseFilter:
    """Filters the poses of k sensors. position, orientation: settings of either part; None leaves it as it is."""

    def __init__(self, count: int, *, position: OneEuroSettings | None, orientation: OneEuroSettings | None) -> None:
        self._filter = _solver.PoseFilter(
            count,
            position=None if position is None else position.cutoffs,
            orientation=None if orientation is None else orientation.cutoffs,
        )

    def step(self, time: FloatArray, position: FloatArray, orientation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Filtered positions (k, 3) and orientations (k, 4) wxyz, unit, of poses at times (k) in s.

        A first value is taken as it is. NaN in, NaN out, and the state waits. Where the time has not risen the answer
        is what it was. Between two calls a pose moves a share of the way to its new value, never beyond. The sign of an
        orientation is that of the one before.
        """
        return self._filter.step(time, np.ascontiguousarray(position), np.ascontiguousarray(orientation))

    def reset(self, rows: BoolArray) -> None:
        """Forget rows (k,): their next pose is taken as it is."""
        self._filter.reset(rows)
