"""Tracks between their frames: positions straight, orientations along the short arc, valid where both ends are."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retarget import rotations
from retarget.rotations import FloatArray

__all__ = ["Instants", "along_arcs", "along_lines", "locate", "valid_at"]

SNAP = 1e-9
"""A time within this share of a frame interval of a frame is that frame, not a mixture of two."""


@dataclass(frozen=True)
class Instants:
    """n times on a clock of T frames.

    before, after (n): neighbouring frames. share (n): way from one to the other, 0 to below 1. exact (n): the time is
    that of frame `before`, whose values are then returned bit for bit.
    """

    before: NDArray[np.intp]
    after: NDArray[np.intp]
    share: FloatArray
    exact: NDArray[np.bool_]


def locate(clock: FloatArray, time: FloatArray) -> Instants:
    """Where the times (n,) lie on a clock (T,) that rises strictly. Times outside of it are held at its ends."""
    held = np.clip(time, clock[0], clock[-1])
    before = np.clip(np.searchsorted(clock, held, side="right") - 1, 0, len(clock) - 1)
    after = np.minimum(before + 1, len(clock) - 1)
    share = (held - clock[before]) / np.where(after > before, clock[after] - clock[before], 1.0)
    before = np.where(share > 1.0 - SNAP, after, before)
    share = np.where((share < SNAP) | (share > 1.0 - SNAP), 0.0, share)
    return Instants(before, np.minimum(before + 1, len(clock) - 1), share, share == 0.0)


def along_lines(track: FloatArray, at: Instants) -> FloatArray:
    """Positions (n, k, 3) of a track (T, k, 3); NaN where a neighbour that counts is NaN."""
    a, b = track[at.before], track[at.after]
    return np.where(at.exact[:, None, None], a, a + at.share[:, None, None] * (b - a))


def along_arcs(track: FloatArray, at: Instants) -> FloatArray:
    """Orientations (n, k, 4) wxyz of a track (T, k, 4); NaN where a neighbour that counts is NaN."""
    a, b = track[at.before], track[at.after]
    share = np.broadcast_to(at.share[:, None], a.shape[:2])
    return np.where(at.exact[:, None, None], a, rotations.slerp(a, b, share))


def valid_at(valid: NDArray[np.bool_], at: Instants) -> NDArray[np.bool_]:
    """Validity (n, k) of a track with validity (T, k)."""
    return np.asarray(valid[at.before] & (at.exact[:, None] | valid[at.after]))
