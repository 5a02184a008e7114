"""Smooth poses: the One-Euro filter on positions and on turns.

A turn is filtered as the rotation vector from the filtered orientation to the new one, seen from the world, never as
that of the orientation itself, which leaps at 180 degrees. So the signs of quaternions say nothing.
"""

from math import isnan

import numpy as np

from retarget.frames import BoolArray
from retarget.live.arcs import along_arc, turn_between
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
        orientation is that of the one before. The arrays are not to be written to: they are the filter's state.
        """
        if self._position is not None:
            position = self._position.step(time, position)
        if self._turn is not None:
            orientation = self._turned(time, orientation, self._turn)
        return position, orientation

    def reset(self, rows: BoolArray | slice = slice(None)) -> None:
        """Forget rows (k,): their next pose is taken as it is."""
        self._orientation = self._orientation.copy()  # the old one was handed out
        self._orientation[rows] = np.nan
        for part in (self._position, self._turn):
            if part is not None:
                part.reset(rows)

    def _turned(self, time: FloatArray, orientation: FloatArray, turn: OneEuro) -> FloatArray:
        """Filtered orientations (k, 4)."""
        before = self._orientation
        ahead = turn_between(before, orientation)
        if isnan(ahead.sum() + time.sum()):
            return self._turned_with_gaps(time, orientation, turn)
        self._orientation = along_arc(before, orientation, turn.shares(time, ahead))
        return self._orientation

    def _turned_with_gaps(self, time: FloatArray, orientation: FloatArray, turn: OneEuro) -> FloatArray:
        """Rows that start, and rows that are not told."""
        told = np.asarray(~(np.isnan(orientation).any(axis=1) | np.isnan(time)))[:, None]
        before = np.where(np.isnan(self._orientation), orientation, self._orientation)
        ahead = np.where(told, turn_between(before, orientation), np.nan)
        after = along_arc(before, orientation, turn.shares(time, ahead))
        self._orientation = np.where(told, after, self._orientation)
        return np.where(told, self._orientation, np.nan)
