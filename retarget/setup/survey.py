"""How near every pair of shapes comes, over sampled postures and over searches that start from the extreme ones.

A sample alone is poor evidence that something never happens. A pair that looks as if it never comes near is therefore
driven together by searches from its nearest posture and from random ones, and one that looks as if it always overlaps
is driven apart in the same way.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.model.body import BodyModel, JointType
from retarget.model.observers import steps_between
from retarget.rotations import normalise
from retarget.setup.enclosing_shapes import solid_geoms
from retarget.setup.observer_proposals import Pair, Proposal, ShapeModel
from retarget.types import FloatArray

# The postures that a robot can take: joint ranges, and samples of them.

UNLIMITED = {JointType.HINGE: np.pi, JointType.SLIDE: 1.0}
"""Half range of a joint without limits, rad or m."""


@dataclass(frozen=True, eq=False)
class JointRanges:
    """lower, upper (m,) rad or m of the hinges and slides at the places `address` (m,) of q; `dofs` (m,) in velocities.

    balls: places in q of ball joints, which take any orientation. notes: what was assumed.
    """

    q0: FloatArray
    address: NDArray[np.int64]
    dofs: NDArray[np.int64]
    lower: FloatArray
    upper: FloatArray
    balls: tuple[int, ...]
    notes: tuple[str, ...]

    def clipped(self, q: FloatArray) -> FloatArray:
        """Postures (..., nq) inside the ranges."""
        inside = q.copy()
        inside[..., self.address] = np.clip(q[..., self.address], self.lower, self.upper)
        return inside

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Postures (count, nq): half of them uniform, a quarter corners of the ranges, a quarter a mixture of both."""
        size = (count, len(self.address))
        uniform = rng.uniform(size=size)
        corners = rng.integers(2, size=size).astype(np.float64)
        mixed = rng.uniform(size=size) < 0.5
        kind = np.arange(count)[:, None] % 4
        share = np.where((kind == 1) | ((kind == 3) & mixed), corners, uniform)
        q = np.repeat(self.q0[None], count, axis=0)
        q[:, self.address] = self.lower + share * (self.upper - self.lower)
        for ball in self.balls:
            q[:, ball : ball + 4] = normalise(rng.normal(size=(count, 4)))
        return q


def joint_ranges(body: BodyModel, limits: Mapping[str, tuple[float, float]]) -> JointRanges:
    """Ranges of a body: `limits` of joints by name (of their servos) before those of its file. A free root stays.

    Raises ConfigError for an unknown joint.
    """
    notes = []
    lower, upper = body.lower.copy(), body.upper.copy()
    for name, (low, high) in limits.items():
        dof = body.joint_dof[body.joint_index(name)]
        lower[dof], upper[dof] = low, high
    scalar = np.isin(body.joint_type, (JointType.HINGE, JointType.SLIDE))
    for joint in np.flatnonzero(scalar):
        dof, kind = body.joint_dof[joint], JointType(body.joint_type[joint])
        if not np.isfinite([lower[dof], upper[dof]]).all():
            half = UNLIMITED[kind]
            lower[dof] = lower[dof] if np.isfinite(lower[dof]) else -half
            upper[dof] = upper[dof] if np.isfinite(upper[dof]) else half
            unit = "m" if kind is JointType.SLIDE else "rad"
            looked = f"{lower[dof]:.2f} to {upper[dof]:.2f} {unit}"
            notes.append(f"joint {body.joint_names[joint]} has no limits, {looked} was looked at")
    dofs = body.joint_dof[scalar]
    return JointRanges(
        q0=body.qpos0,
        address=body.joint_qpos[scalar],
        dofs=dofs,
        lower=lower[dofs],
        upper=upper[dofs],
        balls=tuple(int(place) for place in body.joint_qpos[body.joint_type == JointType.BALL]),
        notes=tuple(notes),
    )


# Looks for the posture in which two shapes are nearest, or farthest: a pattern search over the joints between them.

FIRST_STEP = 0.25
LAST_STEP = 1e-3
"""Steps of the search, as shares of each joint's range."""
RANDOM_STEPS = 4
MAX_LOOKS = 1500


def dofs_between(body: BodyModel, first: int, second: int) -> NDArray[np.int64]:
    """Degrees of freedom that move one link against the other."""
    moving = body.links_between(first, second)
    ends = np.append(body.joint_dof[1:], body.nv)
    found = [
        dof
        for joint, link in enumerate(body.joint_body)
        if int(link) in moving
        for dof in range(int(body.joint_dof[joint]), int(ends[joint]))
    ]
    return np.array(found, dtype=np.int64)


def descend(
    model: ShapeModel,
    ranges: JointRanges,
    pair: Pair,
    q: FloatArray,
    *,
    dofs: NDArray[np.int64],
    sign: float,
    enough: float,
    rng: np.random.Generator,
) -> float:
    """A local minimum, m, of sign * distance, from the posture q (nq,).

    Stops early below `enough`. Every joint is tried by itself, and all in random directions; steps shrink when none
    helps.
    """
    spans = np.full(model.nv, np.pi)
    spans[ranges.dofs] = ranges.upper - ranges.lower

    def value(q: FloatArray) -> float:
        model.place(q)
        return sign * model.distance(pair)

    best, step, looks = value(q), FIRST_STEP, 1
    while step > LAST_STEP and best > enough and looks < MAX_LOOKS:
        found, after, tried = _poll(model, ranges, value, best, q, _steps(dofs, spans * step, rng))
        looks += tried
        if found < best - 1e-9:
            best, q = found, after
        else:
            step /= 2.0
    return best


def _steps(dofs: NDArray[np.int64], spans: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Steps (k, nv) to try: each degree of freedom to both sides, and some random directions."""
    alone = np.zeros((len(dofs), len(spans)))
    alone[np.arange(len(dofs)), dofs] = spans[dofs]
    together = np.zeros((RANDOM_STEPS, len(spans)))
    together[:, dofs] = rng.uniform(-1.0, 1.0, size=(RANDOM_STEPS, len(dofs))) * spans[dofs]
    return np.concatenate([alone, -alone, together])


def _poll(
    model: ShapeModel,
    ranges: JointRanges,
    value: Callable[[FloatArray], float],
    best: float,
    q: FloatArray,
    steps: FloatArray,
) -> tuple[float, FloatArray, int]:
    """Try steps one after the other, each from the best so far: value, posture and number of looks."""
    for step in steps:
        after = ranges.clipped(model.moved(q, step))
        found = value(after)
        if found < best:
            best, q = found, after
    return best, q, len(steps)


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


# How near the geoms of two links come themselves: whether a shape around them hides that they come apart.

SAMPLES = 2000
FAR = 1e3
"""[m]"""


@dataclass(frozen=True)
class OwnDistances:
    """Smallest and largest distance of two links' own geoms over the sample, m, negative inside."""

    smallest: float
    largest: float

    @property
    def may_collide(self) -> bool:
        """Whether they are sometimes apart and sometimes not."""
        return self.smallest < 0.0 < self.largest


def own_distances(model: Any, ranges: JointRanges, links: list[tuple[int, int]], *, seed: int) -> list[OwnDistances]:
    """For pairs of links of the compiled body `model`, over a sample of postures. Deterministic by `seed`."""
    import mujoco

    data = mujoco.MjData(model)
    geoms = [[(a, b) for a in solid_geoms(model, first) for b in solid_geoms(model, second)] for first, second in links]
    found = np.zeros((SAMPLES, len(links)))
    for row, q in enumerate(ranges.sample(np.random.default_rng(seed), SAMPLES)):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        for column, pairs in enumerate(geoms):
            found[row, column] = min(mujoco.mj_geomDistance(model, data, a, b, FAR, None) for a, b in pairs)
    return [OwnDistances(float(column.min()), float(column.max())) for column in found.T]
