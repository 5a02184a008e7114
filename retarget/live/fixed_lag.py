"""Smooth poses at the price of a fixed lag: a Gaussian window over what came before and after."""

from dataclasses import dataclass

import numpy as np

from retarget.frames import BoolArray
from retarget.rotations import FloatArray

__all__ = ["FixedLag", "Smoothed"]

SIGMAS = 2.5
"""Half of the window, in standard deviations."""


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
        self._time = np.full((count, depth), np.nan)
        self._position = np.full((count, depth, 3), np.nan)
        self._orientation = np.full((count, depth, 4), np.nan)
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
        self._time[rows] = np.nan
        self._position[rows] = np.nan
        self._orientation[rows] = np.nan
        self._newest[rows] = -np.inf

    def _means(self) -> Smoothed:
        """The means of every row around half a window before its newest pose."""
        told = self._newest > -np.inf
        newest = np.where(told, self._newest, 0.0)
        # At the start there is less than half a window before the newest: the middle of what there is.
        oldest = np.fmax(newest - 2.0 * self._half, np.fmin.reduce(self._time, axis=1, initial=np.inf))
        centre = 0.5 * (newest + np.minimum(oldest, newest))
        offset = self._time - centre[:, None]
        weight = np.exp(-0.5 * (offset * (SIGMAS / self._half)) ** 2)
        weight = np.where(np.abs(offset) <= self._half * (1.0 + 1e-9), weight, 0.0)
        weight /= np.where(told, weight.sum(axis=1), np.nan)[:, None]
        some = weight > 0.0
        middle = np.where(some, weight, 0.0).argmax(axis=1)
        reference = self._orientation[self._every, middle]
        same_side = np.einsum("knj,kj->kn", self._orientation, reference) >= 0.0
        signed = np.where(same_side, weight, -weight)
        orientation = np.einsum("kn,knj->kj", signed, _or_zero(self._orientation, some))
        norm = np.sqrt(np.einsum("ij,ij->i", orientation, orientation))[:, None]
        return Smoothed(
            centre + np.einsum("kn,kn->k", weight, np.where(some, offset, 0.0)),
            np.einsum("kn,knj->kj", weight, _or_zero(self._position, some)),
            orientation / norm,
        )


def _or_zero(values: FloatArray, some: BoolArray) -> FloatArray:
    """Values (k, n, d) where they count, 0 elsewhere: nothing that is not there spoils a sum."""
    return np.where(some[:, :, None], values, 0.0)
