"""Smooth poses at the price of a fixed lag: a Gaussian window over what came before and after."""

from dataclasses import dataclass

import numpy as np

from retarget.frames import BoolArray
from retarget.rotations import FloatArray

__all__ = ["FixedLag", "Smoothed"]

SIGMAS = 2.5
"""Half of the window, in standard deviations."""
_FOUR = np.ones(4)
"""(values * values).dot(_FOUR) is the quickest sum over rows of four."""


@dataclass(frozen=True, slots=True, eq=False)
class Smoothed:
    """k poses. time (k): s, when they were so: the mean of the times that were taken. position (k, 3) m, orientation
    (k, 4) wxyz; NaN where nothing was told."""

    time: FloatArray
    position: FloatArray
    orientation: FloatArray


class FixedLag:
    """Weighted means of the poses of k sensors over a window of `length` s, half of which is the lag.

    The time that is told with a mean is the mean of the times with the same weights: motion along a line at an even
    speed is exact, however irregular the times, and nothing overshoots. At most `depth` poses are kept of each sensor.
    """

    def __init__(self, count: int, *, length: float = 0.120, depth: int = 64) -> None:
        assert length > 0.0 and depth > 1
        self._half = 0.5 * length
        self._depth = depth
        self._time = np.full((count, depth), np.inf)  # of nothing: outside of every window
        self._position = np.zeros((count, depth, 3))
        self._orientation = np.zeros((count, depth, 4))
        self._newest = np.full(count, -np.inf)
        self._next = np.zeros(count, dtype=np.intp)
        self._every = np.arange(count)

    def step(self, time: FloatArray, position: FloatArray, orientation: FloatArray) -> Smoothed:
        """Take poses at times (k) in s and tell the means half a window before the newest.

        position (k, 3) m, orientation (k, 4) wxyz of any sign. A row whose time has not risen, or that has any NaN, is
        not taken.
        """
        whole = np.isfinite(time) & np.isfinite(position).all(axis=1) & np.isfinite(orientation).all(axis=1)
        taken = np.flatnonzero(whole & (time > self._newest))
        place = self._next[taken]
        self._time[taken, place] = time[taken]
        self._position[taken, place] = position[taken]
        self._orientation[taken, place] = orientation[taken]
        self._newest[taken] = time[taken]
        self._next[taken] = (place + 1) % self._depth
        return self._means()

    def reset(self, rows: BoolArray | slice = slice(None)) -> None:
        """Forget rows (k,)."""
        self._time[rows] = np.inf
        self._newest[rows] = -np.inf

    def _means(self) -> Smoothed:
        """The means of every row around half a window before its newest pose."""
        told = self._newest > -np.inf
        newest = np.where(told, self._newest, 0.0)
        # At the start there is less than half a window before the newest: the middle of what there is.
        oldest = np.clip(self._time.min(axis=1), newest - 2.0 * self._half, newest)
        centre = 0.5 * (newest + oldest)
        offset = self._time - centre[:, None]
        inside = np.abs(offset) <= self._half * (1.0 + 1e-9)
        offset = np.where(inside, offset, 0.0)
        weight = np.where(inside, np.exp(offset * offset * (-0.5 * (SIGMAS / self._half) ** 2)), 0.0)
        weight /= np.where(told, weight.sum(axis=1), np.nan)[:, None]
        reference = self._orientation[self._every, weight.argmax(axis=1)]
        same_side = np.matmul(self._orientation, reference[:, :, None])[:, :, 0] >= 0.0
        signed = np.where(same_side, weight, -weight)[:, None, :]
        orientation = np.matmul(signed, self._orientation)[:, 0]
        norm = np.sqrt((orientation * orientation).dot(_FOUR))[:, None]
        time = centre + (weight * offset).sum(axis=1)
        return Smoothed(time, np.matmul(weight[:, None, :], self._position)[:, 0], orientation / norm)
