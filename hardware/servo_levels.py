"""Bounds of quantities that may be exceeded for some time."""

from collections.abc import Sequence

import numpy as np

from hardware.arrays import BoolArray, FloatArray

ROUND_OFF = 1e-9
"""[s] by which sums of ticks may miss a patience."""


class ServoLevels:
    """Bounds of rows of values (rows, n), a pair of least and most for each row, and a patience, s, for each.

    Unknown values (NaN) are within every bound.
    """

    def __init__(self, bounds: Sequence[tuple[float, float]], patience: Sequence[float], count: int) -> None:
        self.least = np.array([[least] * count for least, _ in bounds])  # (rows, n)
        self.most = np.array([[most] * count for _, most in bounds])
        self._patience = np.array(patience)[:, None] - ROUND_OFF
        self._nothing = np.full(self.least.shape, np.inf)
        self._since = self._nothing  # [s] since when each is beyond, infinite where it is not
        self.waiting = False
        """Whether something is beyond that was to be beyond for longer, as far as it was looked at."""

    def beyond(self, seen: FloatArray, now: float) -> BoolArray:
        """Which values (rows, n) are beyond their bounds at `now`, s, and were for the whole of their patience."""
        out = (seen < self.least) | (seen > self.most)
        self._since = np.where(out, np.minimum(self._since, now), np.inf)
        late = now - self._since >= self._patience
        self.waiting = bool(out.any())
        return np.asarray(out & late)

    def forget(self) -> None:
        """Nothing is beyond."""
        self._since, self.waiting = self._nothing, False
