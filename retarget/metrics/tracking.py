"""How well a run followed: errors, lag, and whether it moved as far as it was asked. Ticks with NaN take no part."""

import numpy as np

from retarget.rotations import FloatArray

__all__ = ["distances", "excursion_ratio", "lag", "path_ratio"]

STILL_M = 1e-3
"""What is asked to move less than this, m, says nothing about moving."""
COARSE = 4
"""Lags are looked at in steps of so many ticks first: no body moves so fast that a peak is narrower."""


def distances(asked: FloatArray, reached: FloatArray) -> FloatArray:
    """Distance (T, k) m between tracks (T, k, 3)."""
    return np.asarray(np.linalg.norm(reached - asked, axis=-1))


def path_ratio(asked: FloatArray, reached: FloatArray) -> float | None:
    """Length of the paths reached over that of the paths asked, tracks (T, k, 3); None where nothing was asked to move.

    A robot that stands still shows 0.
    """
    known = np.isfinite(asked).all(axis=(1, 2)) & np.isfinite(reached).all(axis=(1, 2))
    if np.count_nonzero(known) < 2:
        return None
    wanted = _path_length(asked[known])
    return None if wanted < STILL_M else _path_length(reached[known]) / wanted


def excursion_ratio(asked: FloatArray, reached: FloatArray) -> float | None:
    """Range of the heights reached over that of the heights asked, (T,) m; None where nothing was asked to move."""
    known = np.isfinite(asked) & np.isfinite(reached)
    if not known.any():
        return None
    wanted = float(np.ptp(asked[known]))
    return None if wanted < STILL_M else float(np.ptp(reached[known])) / wanted


def lag(asked: FloatArray, reached: FloatArray, dt: float, *, longest: float = 1.0) -> float | None:
    """Time (s) by which tracks reached (T, k, 3) m trail those asked, where their cross-correlation is highest.

    All coordinates together, each about its mean over the ticks compared; lags from 0 to `longest` s, between ticks by
    a parabola. None where either stands still.
    """
    known = np.isfinite(asked).all(axis=(1, 2)) & np.isfinite(reached).all(axis=(1, 2))
    a, b = (track[known].reshape(np.count_nonzero(known), 3 * track.shape[1]) for track in (asked, reached))
    steps = min(round(longest / dt), len(a) // 2)
    if steps < 2 or _spread(a) < STILL_M or _spread(b) < STILL_M:
        return None
    coarse = range(0, steps + 1, COARSE)
    near = max(coarse, key=lambda step: _correlation(a, b, step))
    first, last = max(near - COARSE, 0), min(near + COARSE, steps)
    score = np.array([_correlation(a, b, step) for step in range(first, last + 1)])
    best = int(np.argmax(score))
    return float((first + best + _vertex(score, best)) * dt)


def _path_length(track: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(track, axis=0), axis=-1).sum())


def _centred(track: FloatArray) -> FloatArray:
    """Columns (T, c) about their means."""
    return np.asarray(track - track.mean(axis=0))


def _spread(track: FloatArray) -> float:
    """Root mean square of the distance of (T, c) from its mean, m."""
    return float(np.sqrt(np.mean(np.sum(_centred(track) ** 2, axis=1))))


def _correlation(asked: FloatArray, reached: FloatArray, step: int) -> float:
    """Normalised correlation of what was asked with what was reached `step` ticks later."""
    a, b = _centred(asked[: len(asked) - step]), _centred(reached[step:])
    return _inner(a, b) / float(np.sqrt(_inner(a, a) * _inner(b, b)))


def _inner(a: FloatArray, b: FloatArray) -> float:
    """Sum of products. Not by BLAS, whose threads wait for each other on a busy machine."""
    return float(np.einsum("ij,ij->", a, b))


def _vertex(score: FloatArray, best: int) -> float:
    """Where the parabola through three neighbours peaks, in ticks from `best`; 0 at the ends."""
    if best in (0, len(score) - 1):
        return 0.0
    before, here, after = score[best - 1 : best + 2]
    bend = before - 2.0 * here + after
    return 0.0 if bend >= 0.0 else float(0.5 * (before - after) / bend)
