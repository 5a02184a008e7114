"""A way that is laid out tick by tick, and can be gone along slower."""

import numpy as np

from retarget.rotations import FloatArray

__all__ = ["PacedWay"]


class PacedWay:
    """Postures (m, n) rad, a tick from row to row, the first where the robot is."""

    def __init__(self, rows: FloatArray) -> None:
        self._rows = rows
        self._at = 0.0  # rows gone so far

    @property
    def done(self) -> bool:
        """Whether the last posture was returned."""
        return self._at >= len(self._rows) - 1

    def next(self, pace: float = 1.0) -> FloatArray:
        """The posture (n,) after one tick at a share (0, 1] of its speed; at the end the last one."""
        self._at = min(self._at + pace, len(self._rows) - 1.0)
        row = int(self._at)
        share = self._at - row
        if share == 0.0:
            return np.array(self._rows[row])
        between: FloatArray = self._rows[row] + share * (self._rows[row + 1] - self._rows[row])
        return between
