"""A way that is laid out tick by tick, and can be gone along slower, or left and taken up again."""

import numpy as np

from retarget.rotations import FloatArray

__all__ = ["REJOINING_S", "PacedWay"]

REJOINING_S = 0.75
"""s in which somebody who stood beside the way is back on it, and at full pace."""


class PacedWay:
    """Postures (m, n) rad, a tick of `dt` s from row to row, the first where the robot is."""

    def __init__(self, rows: FloatArray, *, dt: float, straight: int = 0) -> None:
        """straight: so many rows lie in one line with the first."""
        self._rows, self._straight = rows, straight
        self._rejoining = round(REJOINING_S / dt)  # ticks
        self._at = 0.0  # rows gone so far
        self._left = False
        self._beside = np.zeros(rows.shape[1])  # [rad] from where it was left to where it was taken up
        self._since = self._rejoining  # ticks since then

    @property
    def ticks(self) -> int:
        """That it takes at full pace, if it is never left."""
        return len(self._rows) - 1

    @property
    def done(self) -> bool:
        """Whether the last posture was returned."""
        return self._at >= len(self._rows) - 1 and self._since >= self._rejoining and not self._left

    @property
    def straight(self) -> bool:
        """Whether the robot is still on its first part, in one line with where it began."""
        return self._at <= self._straight

    @property
    def left(self) -> bool:
        """Whether the robot does something else."""
        return self._left

    def leave(self) -> None:
        """The robot does something else, and will stand when it goes on."""
        self._left = True

    def next(self, pace: float = 1.0, *, here: FloatArray | None = None) -> FloatArray:
        """The posture (n,) after one tick at a share (0, 1] of its speed; at the end the last one.

        here: where the robot stands, (n,), if the way was left: from there, slowly at first, it comes back onto it.
        """
        if self._left and here is not None:
            self._left, self._since = False, 0
            self._beside = here - self._there()
        if self._since >= self._rejoining:
            return self._go(pace)
        self._since += 1
        share = self._since / self._rejoining
        back = share * share * (3.0 - 2.0 * share)
        return self._go(pace * back) + (1.0 - back) * self._beside

    def _go(self, rows: float) -> FloatArray:
        self._at = min(self._at + rows, len(self._rows) - 1.0)
        return self._there()

    def _there(self) -> FloatArray:
        """Where on the way it is, (n,)."""
        row = int(self._at)
        share = self._at - row
        if share == 0.0:
            return np.array(self._rows[row])
        between: FloatArray = self._rows[row] + share * (self._rows[row + 1] - self._rows[row])
        return between
