"""The smallest distance of many pairs over many postures, without a look at most of them.

Signed distance changes by no more than the two shapes move (Hausdorff distance; inside as outside). So between two
postures a and b, in which a pair is d_a and d_b apart and which its shapes travel W in all between, it is never nearer
than (d_a + d_b - W) / 2. Where that might be the nearest, or inside, the posture in the middle is looked at.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retarget.rotations import FloatArray

__all__ = ["Closest", "Distances", "closest_pairs"]

IntArray = NDArray[np.int64]
Distances = Callable[[IntArray, IntArray], FloatArray]
"""Signed distances (m,) of pairs (m,) in postures (m,), m; the postures come in rising order."""


@dataclass(frozen=True, eq=False)
class Closest:
    """smallest: m, at `row` of `pair`, numbers of posture and pair. deeper: how many postures, for each tolerance."""

    smallest: float
    row: int
    pair: int
    deeper: tuple[int, ...]


def closest_pairs(distances: Distances, way: FloatArray, *, tolerances: tuple[float, ...]) -> Closest:
    """Look at pairs over postures; way (T, P): what the two shapes of each pair travelled since the first posture, m.

    tolerances: depths, m, rising. Raises ValueError without postures or pairs.
    """
    rows, pairs = way.shape
    if not rows or not pairs:
        raise ValueError(f"nothing to compare: {rows} postures, {pairs} pairs")
    search = _Search(distances, rows, tolerances)
    every = np.arange(pairs, dtype=np.int64)
    first = search.look(np.zeros(pairs, dtype=np.int64), every)
    last = search.look(np.full(pairs, rows - 1, dtype=np.int64), every)
    spans = _Spans(every, np.zeros(pairs, dtype=np.int64), np.full(pairs, rows - 1, dtype=np.int64), first, last)
    while len(spans.pair):
        spans = spans.chosen(search.may_matter(spans, way))
        middle = (spans.start + spans.end) // 2
        order = np.argsort(middle, kind="stable")
        spans, middle = spans.chosen(order), middle[order]
        spans = spans.halved(middle, search.look(middle, spans.pair))
    return search.found()


@dataclass(frozen=True, eq=False)
class _Spans:
    """Stretches (s,) of postures, from `start` to `end`, of a pair, and its distance at both."""

    pair: IntArray
    start: IntArray
    end: IntArray
    first: FloatArray
    last: FloatArray

    def chosen(self, which: NDArray[np.bool_] | IntArray) -> "_Spans":
        return _Spans(self.pair[which], self.start[which], self.end[which], self.first[which], self.last[which])

    def halved(self, middle: IntArray, distance: FloatArray) -> "_Spans":
        """Both halves of each."""
        return _Spans(
            np.concatenate([self.pair, self.pair]),
            np.concatenate([self.start, middle]),
            np.concatenate([middle, self.end]),
            np.concatenate([self.first, distance]),
            np.concatenate([distance, self.last]),
        )


class _Search:
    """What is known so far: the nearest of each posture that was looked at, and the nearest of all."""

    def __init__(self, distances: Distances, rows: int, tolerances: tuple[float, ...]) -> None:
        self._distances = distances
        self._tolerances = tolerances
        self._nearest = np.full(rows, np.inf)  # (T,) [m]
        self._best = (np.inf, 0, 0)

    def look(self, rows: IntArray, pairs: IntArray) -> FloatArray:
        """Distances (m,) of pairs in postures."""
        distance = self._distances(rows, pairs)
        if len(distance):
            np.minimum.at(self._nearest, rows, distance)
            k = int(np.argmin(distance))
            self._best = min(self._best, (float(distance[k]), int(rows[k]), int(pairs[k])))
        return distance

    def may_matter(self, spans: _Spans, way: FloatArray) -> NDArray[np.bool_]:
        """Which spans (s,) may hold the nearest of all, or a depth that is not yet known of one of their postures."""
        travel = way[spans.end, spans.pair] - way[spans.start, spans.pair]
        bound = 0.5 * (spans.first + spans.last - travel)
        matters = bound < self._best[0]
        inside = spans.end - spans.start - 1
        for depth in self._tolerances:
            known = np.concatenate([[0], np.cumsum(self._nearest < -depth)])
            open_rows = known[spans.end] - known[spans.start + 1] < inside
            matters |= (bound < -depth) & open_rows
        return np.asarray(matters & (inside > 0))

    def found(self) -> Closest:
        deeper = tuple(int(np.count_nonzero(self._nearest < -depth)) for depth in self._tolerances)
        return Closest(*self._best, deeper)
