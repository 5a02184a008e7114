"""A way laid out tick by tick, laid out again so that no joint is faster than it may be: slower only where it must."""

import numpy as np

from retarget.rotations import FloatArray

__all__ = ["laid_within"]

SMOOTHING = 20
"""Rows to each side over which the pace changes, at first; more where servos could not follow that."""
ROUND_OFF = 1e-9
"""Share of a limit: less beyond it is rounding."""


def laid_within(rows: FloatArray, *, most: FloatArray, change: FloatArray) -> FloatArray:
    """The same way as rows (m, n) rad, a tick from row to row, in more ticks (k, n), from its first row to its last.

    most (n,): rad, the longest step of a joint; change (n,): rad, what a step may differ from the one before, where
    those of the way itself do not differ more.
    """
    if len(rows) < 2:
        return rows
    steps = np.abs(np.diff(rows, axis=0))
    share = (steps / most).max(axis=1)  # (m - 1,)
    if share.max() <= 1.0 + ROUND_OFF:
        return rows
    pace = np.minimum(1.0, 1.0 / np.maximum(share, ROUND_OFF))
    sharpest = np.maximum(change, np.abs(np.diff(rows, n=2, axis=0)).max(axis=0, initial=0.0)) * (1.0 + ROUND_OFF)
    width = SMOOTHING
    while width < len(rows):
        laid = _laid(rows, _smooth(pace, width))
        if (np.abs(np.diff(laid, n=2, axis=0)) <= sharpest).all():
            return laid
        width *= 2
    return _laid(rows, np.full(len(pace), pace.min()))


def _smooth(pace: FloatArray, width: int) -> FloatArray:
    """A pace (m,) that changes gently and is nowhere greater than the one given."""
    least = np.lib.stride_tricks.sliding_window_view(np.pad(pace, 2 * width, mode="edge"), 2 * width + 1).min(axis=1)
    return np.convolve(least, np.full(2 * width + 1, 1.0 / (2 * width + 1)), mode="valid")


def _laid(rows: FloatArray, pace: FloatArray) -> FloatArray:
    """The way at a pace (m - 1,) in rows per tick, of each step."""
    at = np.concatenate([[0.0], np.cumsum(1.0 / pace)])  # [ticks] when each row is reached
    ticks = np.minimum(np.arange(int(np.ceil(at[-1] - ROUND_OFF)) + 1), at[-1])
    places = np.interp(ticks, at, np.arange(len(rows)))
    return np.stack([np.interp(places, np.arange(len(rows)), joint) for joint in rows.T], axis=1)
