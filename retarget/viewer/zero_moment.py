"""The zero-moment point of a motion that is looked at: where the floor would have to push."""

from collections import deque

import numpy as np

from retarget.rotations import FloatArray

__all__ = ["SPACING_S", "MassMotion", "around_row", "zero_moment_point"]

GRAVITY = 9.81  # [m/s^2]
SPACING_S = 0.04
"""Between the three looks at the centre of mass of which its acceleration is made: a mean over twice that."""
LONGEST_S = 0.2
"""Looks that are farther apart tell nothing."""


def zero_moment_point(times: FloatArray, com: FloatArray) -> FloatArray:
    """Where it was, (2,) m on the floor, at the second of three times (3,) s, of a centre of mass at com (3, 3) m.

    As in `standing_balance`, with all mass in one point: p = c - z / (g + z'') c''. NaN where times are not apart, or
    too far, and where it falls freely.
    """
    before, after = np.diff(times)
    if not (0.0 < before <= LONGEST_S and 0.0 < after <= LONGEST_S):
        return np.full(2, np.nan)
    change = (com[2] - com[1]) / after - (com[1] - com[0]) / before
    acceleration = 2.0 * change / (before + after)
    weight = GRAVITY + acceleration[2]
    if weight <= 0.0:
        return np.full(2, np.nan)
    point: FloatArray = com[1, :2] - com[1, 2] / weight * acceleration[:2]
    return point


def around_row(times: FloatArray, row: int) -> tuple[int, int, int]:
    """The row of times (T,) s, with one about SPACING_S before and one as long after it; NaN comes of those that are
    not there."""
    before, after = np.searchsorted(times, times[row] + np.array([-SPACING_S, SPACING_S]) - 1e-6)
    last = len(times) - 1
    return max(min(int(before), row - 1), 0), row, min(max(int(after), row + 1), last)


class MassMotion:
    """Looks at a centre of mass that moves."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, FloatArray]] = deque(maxlen=3)

    def look(self, time: float, com: FloatArray) -> FloatArray:
        """The centre of mass com (3,) m at a time, s. Returns the zero-moment point (2,) m of one look before."""
        if not self._seen or time > self._seen[-1][0]:
            self._seen.append((time, com))
        if len(self._seen) < 3:
            return np.full(2, np.nan)
        times, places = zip(*self._seen, strict=True)
        return zero_moment_point(np.array(times), np.array(places))
