"""Smooth poses: the One-Euro filter on positions and on turns.

A turn is filtered as the rotation vector from the filtered orientation to the new one, seen from the world, never as
that of the orientation itself, which leaps at 180 degrees. So the signs of quaternions say nothing.
"""

import numpy as np

from retarget import rotations
from retarget.frames import BoolArray
from retarget.live.one_euro import OneEuro, OneEuroSettings
from retarget.rotations import FloatArray

__all__ = ["PoseFilter"]


class PoseFilter:
    """Filters the poses of k sensors. position, orientation: settings of either part; None leaves it as it is."""

    def __init__(self, count: int, *, position: OneEuroSettings | None, orientation: OneEuroSettings | None) -> None:
        self._position = None if position is None else OneEuro(count, 3, position)
        self._turn = None if orientation is None else OneEuro(count, 3, orientation)
        self._orientation = np.full((count, 4), np.nan)

    def step(self, time: FloatArray, position: FloatArray, orientation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Filtered positions (k, 3) and orientations (k, 4) wxyz, unit, of poses at times (k) in s.

        NaN in, NaN out, and the state waits. Where the time has not risen the answer is what it was. The sign of an
        orientation is that of the one before.
        """
        if self._position is not None:
            position = self._position.step(time, position)
        if self._turn is not None:
            orientation = self._turned(time, orientation, self._turn)
        return position, orientation

    def reset(self, rows: BoolArray | slice = slice(None)) -> None:
        """Forget rows (k,): their next pose is taken as it is."""
        self._orientation[rows] = np.nan
        for part in (self._position, self._turn):
            if part is not None:
                part.reset(rows)

    def _turned(self, time: FloatArray, orientation: FloatArray, turn: OneEuro) -> FloatArray:
        """Filtered orientations (k, 4)."""
        told = ~(np.isnan(orientation).any(axis=1) | np.isnan(time))
        fresh = np.isnan(self._orientation[:, 0])
        before = np.where(fresh[:, None], orientation, self._orientation)
        ahead = rotations.log(rotations.multiply(orientation, rotations.conjugate(before)))
        step = rotations.from_rotation_vector(turn.increment(time, ahead))
        after = rotations.normalise(rotations.multiply(step, before))
        self._orientation = np.where(told[:, None], after, self._orientation)
        return np.where(told[:, None], self._orientation, np.nan)
