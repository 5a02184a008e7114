"""How near every pair of shapes comes, over sampled postures and over searches that start from the extreme ones.

A sample alone is poor evidence that something never happens. A pair that looks as if it never comes near is therefore
driven together by searches from its nearest posture and from random ones, and one that looks as if it always overlaps
is driven apart in the same way.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from retarget.body import BodyModel
from retarget.fitting.proposals import Proposal
from retarget.fitting.ranges import JointRanges
from retarget.fitting.search import descend, dofs_between
from retarget.fitting.shape_model import Pair, ShapeModel
from retarget.observer_pairs import steps_between
from retarget.rotations import FloatArray

__all__ = ["SAFETY_FACTOR", "SEARCHES", "PairRecord", "survey"]

SAFETY_FACTOR = 1.5
"""A pair is never near if it keeps so many times the influence."""
SEARCHES = 20
"""Searches of each pair that looks decided."""


@dataclass(frozen=True, eq=False)
class PairRecord:
    """Two shapes, and how near they come. Distances in m, negative inside.

    smallest: the smallest found. largest: the largest found of a pair that always overlaps, None for any other.
    at_neutral: in the neutral posture. samples, searches: how many postures were looked at, how many searches made.
    """

    pair: Pair
    smallest: float
    largest: float | None
    at_neutral: float
    samples: int
    searches: int


def survey(
    body: BodyModel,
    proposals: tuple[Proposal, ...],
    ranges: JointRanges,
    *,
    neutral: FloatArray,
    near: float,
    samples: int,
    seed: int,
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[PairRecord, ...]:
    """A record of every pair that is more than one joint apart, in the order of the proposals.

    neutral: posture (nq,) that is looked at first. near: distance, m, that no search needs to go below. progress takes
    the share that is done. Deterministic by `seed`.
    """
    rng = np.random.default_rng(seed)
    pairs = _pairs(body, proposals)
    model = ShapeModel(body, proposals)
    postures = np.concatenate([neutral[None], ranges.sample(rng, samples)])
    extremes = _Extremes(model, pairs)
    for row, q in enumerate(postures):
        extremes.look(row, q)
        progress(0.5 * row / len(postures))
    records = []
    for index, pair in enumerate(pairs):
        record = extremes.record(index, pair, len(postures))
        dofs = dofs_between(body, proposals[pair[0]].link, proposals[pair[1]].link)
        starts = ranges.sample(rng, SEARCHES)
        starts[0] = postures[extremes.nearest[index] if record.smallest > near else extremes.farthest[index]]
        records.append(_searched(record, model, ranges, starts, dofs=dofs, near=near, rng=rng))
        progress(0.5 + 0.5 * (index + 1) / len(pairs))
    return tuple(records)


def _pairs(body: BodyModel, proposals: tuple[Proposal, ...]) -> list[Pair]:
    links = [proposal.link for proposal in proposals]
    return [
        (first, second)
        for second in range(len(links))
        for first in range(second)
        if steps_between(body, links[first], links[second]) > 1
    ]


def _searched(
    record: PairRecord,
    model: ShapeModel,
    ranges: JointRanges,
    starts: FloatArray,
    *,
    dofs: NDArray[np.int64],
    near: float,
    rng: np.random.Generator,
) -> PairRecord:
    """The record after searches from postures (k, nq), where it looks decided; until it no longer does."""
    if record.smallest > near:
        sign, best, enough = 1.0, record.smallest, near
    elif record.largest is not None:
        sign, best, enough = -1.0, -record.largest, 0.0
    else:
        return record
    searches = 0
    for start in starts:
        searches += 1
        best = min(best, descend(model, ranges, record.pair, start, dofs=dofs, sign=sign, enough=enough, rng=rng))
        if best <= enough:
            break
    if sign > 0.0:
        return replace(record, smallest=best, searches=searches)
    return replace(record, largest=-best if best > 0.0 else None, searches=searches)


class _Extremes:
    """Nearest and farthest that each pair (k) came: smallest, largest (k,) m, nearest, farthest (k,) the postures.

    largest is followed only as long as a pair has overlapped in every posture.
    """

    def __init__(self, model: ShapeModel, pairs: list[Pair]) -> None:
        self._model = model
        self._pairs = pairs
        self._places = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        count = len(pairs)
        self.smallest = np.full(count, np.inf)
        self.largest = np.full(count, -np.inf)
        self.at_neutral = np.full(count, np.inf)
        self.nearest = np.zeros(count, dtype=np.int64)
        self.farthest = np.zeros(count, dtype=np.int64)

    def look(self, row: int, q: FloatArray) -> None:
        """Look at posture number `row`, q (nq,); the first one is the neutral one."""
        self._model.place(q)
        bound = self._model.at_least(self._places[:, 0], self._places[:, 1])
        for index in np.flatnonzero((bound < self.smallest) | (self.largest < 0.0)):
            distance = self._model.distance(self._pairs[index])
            if row == 0:
                self.at_neutral[index] = distance
            if distance < self.smallest[index]:
                self.smallest[index], self.nearest[index] = distance, row
            if distance > self.largest[index] and self.largest[index] < 0.0:
                self.largest[index], self.farthest[index] = distance, row

    def record(self, index: int, pair: Pair, samples: int) -> PairRecord:
        """What was seen of one pair."""
        largest = float(self.largest[index])
        return PairRecord(
            pair=pair,
            smallest=float(self.smallest[index]),
            largest=largest if largest < 0.0 else None,
            at_neutral=float(self.at_neutral[index]),
            samples=samples,
            searches=0,
        )
