"""The fixed-lag smoother as a filter of sensors, any of which may tell a place, a turn, or both."""

import numpy as np

from retarget.frames import BoolArray
from retarget.live.fixed_lag import FixedLag
from retarget.rotations import IDENTITY, FloatArray

__all__ = ["WindowFilter"]

_NOWHERE = np.zeros(3)


class WindowFilter:
    """As `PoseFilter` is used: poses of k sensors in, smooth ones out, half a window late. length: of the window, s."""

    def __init__(self, count: int, *, length: float = 0.120) -> None:
        self._lag = FixedLag(count, length=length)
        self._told = np.zeros((count, 2), dtype=np.bool_)

    def step(self, time: FloatArray, position: FloatArray, orientation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Smooth positions (k, 3) and orientations (k, 4) wxyz of poses at times (k) in s; NaN in, NaN out.

        A sensor that begins to tell its place or its turn, or ceases to, is smoothed from there on.
        """
        told = np.isfinite(np.stack([position[:, 0], orientation[:, 0]], axis=1))
        changed = (told != self._told).any(axis=1)
        if changed.any():
            self._lag.reset(changed)
            self._told = told
        placed, turned = told[:, :1], told[:, 1:]
        known = told.any(axis=1)
        when = np.where(known, time, np.nan)
        found = self._lag.step(
            when, np.where(placed, position, _NOWHERE), np.where(turned, orientation, np.asarray(IDENTITY))
        )
        return np.where(placed, found.position, np.nan), np.where(turned, found.orientation, np.nan)

    def reset(self, rows: BoolArray) -> None:
        """Forget rows (k,): their next pose is taken as it is."""
        self._lag.reset(rows)
