"""How far servos are from where they were sent, and how much of that their lag does not explain."""

import numpy as np

from retarget.rotations import FloatArray

__all__ = ["REMEMBERED_S", "FollowingError"]

REMEMBERED_S = 0.25
"""A servo that is where it was sent at most so long (s) ago lags; one that is elsewhere is off its way."""
ROUNDING_TICKS = 2.0
"""Encoder steps by which a servo that goes well may be off: its goal and its position are both rounded, and it holds
within a step."""


class FollowingError:
    """The goals (n,) rad of the last ticks, a range for each joint. tick_rad (n,): rad per encoder step."""

    def __init__(self, tick_rad: FloatArray, *, dt: float) -> None:
        self._slack = ROUNDING_TICKS * np.abs(tick_rad)
        self._goals = np.zeros((max(2, round(REMEMBERED_S / dt)), tick_rad.size))
        self._row = 0

    def seed(self, position: FloatArray) -> None:
        """All that was ever sent is `position` (n,)."""
        self._goals[:] = position

    def sent(self, goal: FloatArray) -> None:
        """Remember a goal (n,)."""
        self._row = (self._row + 1) % len(self._goals)
        self._goals[self._row] = goal

    def unexplained(self, measured: FloatArray) -> FloatArray:
        """How far `measured` (n,) is outside of what was sent lately, rad, signed; 0 within."""
        lo, hi = self._goals.min(axis=0) - self._slack, self._goals.max(axis=0) + self._slack
        off: FloatArray = measured - np.minimum(np.maximum(measured, lo), hi)
        return off
