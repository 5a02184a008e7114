"""How near every pair of shapes comes, over sampled postures and over searches that start from the extreme ones.

A sample alone is poor evidence that something never happens. A pair that looks as if it never comes near is therefore
driven together by searches from its nearest posture and from random ones, and one that looks as if it always overlaps
is driven apart in the same way.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from retarget import _solver
from retarget.model.body import BodyModel, JointType
from retarget.model.observers import steps_between
from retarget.rotations import multiply, normalise
from retarget.setup.shape_fit import LinkGeometry, Proposal, canonical_shape
from retarget.types import BoolArray, FloatArray, IntArray

# The postures that a robot can take: joint ranges, and samples of them.

UNLIMITED = {JointType.HINGE: (np.pi, "rad"), JointType.SLIDE: (1.0, "m")}
"""Half range of a joint without limits, and its unit."""


@dataclass(frozen=True, eq=False)
class JointRanges:
    """lower, upper (m,) rad or m of the hinges and slides at the places `address` (m,) of q, on `links` (m,).

    balls: places in q of ball joints, which take any orientation. notes: what was assumed.
    """

    q0: FloatArray
    address: IntArray
    links: IntArray
    lower: FloatArray
    upper: FloatArray
    balls: tuple[int, ...]
    notes: tuple[str, ...]

    def clipped(self, q: FloatArray) -> FloatArray:
        """Clip postures (..., nq), rad or m, to the ranges."""
        inside = q.copy()
        inside[..., self.address] = np.clip(q[..., self.address], self.lower, self.upper)
        return inside

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Postures (count, nq): half of them uniform, a quarter corners of the ranges, a quarter a mixture of both."""
        size = (count, len(self.address))
        uniform = rng.uniform(size=size)
        corners = rng.integers(2, size=size).astype(np.float64)
        often = np.array([0.0, 1.0, 0.0, 0.5])[np.arange(count) % 4]
        share = np.where(rng.uniform(size=size) < often[:, None], corners, uniform)
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
    for name, interval in limits.items():
        dof = body.joint_dof[body.joint_index(name)]
        lower[dof], upper[dof] = interval
    scalar = np.isin(body.joint_type, (JointType.HINGE, JointType.SLIDE))
    low, high = lower[body.joint_dof[scalar]], upper[body.joint_dof[scalar]]
    for row, joint in enumerate(np.flatnonzero(scalar)):
        if not np.isfinite(low[row]) or not np.isfinite(high[row]):
            half, unit = UNLIMITED[JointType(body.joint_type[joint])]
            low[row] = np.nan_to_num(low[row], neginf=-half)
            high[row] = np.nan_to_num(high[row], posinf=half)
            looked = f"{low[row]:.2f} to {high[row]:.2f} {unit}"
            notes.append(f"joint {body.joint_names[joint]} has no limits, {looked} was looked at")
    return JointRanges(
        q0=body.qpos0,
        address=body.joint_qpos[scalar],
        links=body.joint_body[scalar],
        lower=low,
        upper=high,
        balls=tuple(int(place) for place in body.joint_qpos[body.joint_type == JointType.BALL]),
        notes=tuple(notes),
    )


# The proposed shapes on the robot's tree, and the distances between them in many postures at once.

Pair = tuple[int, int]
"""Two shapes by their place in the list of proposals, the smaller one first."""


class PlacedShapes:
    """Shapes on the links of a body."""

    def __init__(self, body: BodyModel, proposals: tuple[Proposal, ...]) -> None:
        rows = [canonical_shape(proposal.shape) for proposal in proposals]
        self._body = body.solver_body()
        self._links = np.array([proposal.link for proposal in proposals])
        self._kinds = np.array([row[0] for row in rows], dtype=np.int64)
        self._sizes, self._positions, self._quats = (
            np.array([row[column] for row in rows], dtype=np.float64) for column in (1, 2, 3)
        )

    def distances(self, postures: FloatArray, pairs: IntArray) -> FloatArray:
        """Signed distances (t, p), m, of pairs (p, 2) of shapes in postures (t, nq)."""
        count, both = len(postures), pairs.T.ravel()
        links = self._links[both].tolist()
        position = self._body.points(np.ascontiguousarray(postures), links, self._positions[both])
        quat = multiply(self._body.orientations(np.ascontiguousarray(postures), links), self._quats[both])
        sides: list[Any] = []
        for half in np.split(np.arange(len(both)), 2):
            sides += [np.tile(self._kinds[both[half]], count), np.tile(self._sizes[both[half]], (count, 1))]
            sides += [np.take(part, half, axis=1).reshape(-1, part.shape[2]) for part in (position, quat)]
        return _solver.shape_distances(*sides)[0].reshape(count, len(pairs))


# Looks for the posture in which two shapes are nearest, or farthest: pattern searches over the joints between them.

FIRST_STEP = 0.25
LAST_STEP = 1e-3
"""Steps of a search, as shares of each joint's range."""
RANDOM_STEPS = 12
MAX_ROUNDS = 60
"""Steps in random directions of a round, beside those along each joint, and the most rounds of a search."""


def search(
    shapes: PlacedShapes,
    ranges: JointRanges,
    pair: Pair,
    starts: FloatArray,
    *,
    moving: BoolArray,
    sign: float,
    enough: float,
    rng: np.random.Generator,
) -> float:
    """The smallest sign * distance, m, that searches from postures `starts` (k, nq) find, all at once.

    moving (m,): the joints that move one shape against the other. Every search tries each of them by itself and all in
    random directions, takes the best, and halves its step where none helps. All stop early below `enough`.
    """
    address, spans = ranges.address[moving], (ranges.upper - ranges.lower)[moving]
    pairs, alone = np.array([pair]), np.eye(len(address))
    q, best = starts, sign * shapes.distances(starts, np.array([pair]))[:, 0]
    step = np.full(len(q), FIRST_STEP)
    for _ in range(MAX_ROUNDS):
        if best.min() <= enough or step.max() <= LAST_STEP:
            break
        together = rng.uniform(-1.0, 1.0, size=(RANDOM_STEPS, len(address)))
        tried = np.repeat(q[:, None], 2 * len(address) + RANDOM_STEPS, axis=1)
        tried[:, :, address] += step[:, None, None] * spans * np.concatenate([alone, -alone, together])
        tried = ranges.clipped(tried)
        found = sign * shapes.distances(tried.reshape(-1, q.shape[1]), pairs).reshape(len(q), -1)
        least, gained = found.argmin(axis=1), found.min(axis=1) < best - 1e-9
        q = np.where(gained[:, None], tried[np.arange(len(q)), least], q)
        best = np.where(gained, found.min(axis=1), best)
        step = np.where(gained, step, step / 2.0)
    return float(best.min())


SAFETY_FACTOR = 1.5
"""A pair is never near if it keeps so many times the influence."""
SEARCHES = 20
"""Searches of each pair that looks decided."""
BLOCK = 200
"""Postures that are looked at together."""


@dataclass(frozen=True, eq=False)
class PairRecord:
    """Two shapes, and how near they come. Distances in m, negative inside.

    smallest: the smallest found. largest: the largest found of a pair that always overlaps, None for any other. own:
    smallest and largest distance of the links' own geoms, of a pair that always overlaps. at_neutral: in the neutral
    posture. samples, searches: how many postures were looked at, how many searches made.
    """

    pair: Pair
    smallest: float
    largest: float | None
    at_neutral: float
    samples: int
    searches: int
    own: tuple[float, float] | None = None

    @property
    def hides_collision(self) -> bool:
        """Whether shapes that always overlap are around geoms that are sometimes apart and sometimes not."""
        return self.own is not None and self.own[0] < 0.0 < self.own[1]


def survey(
    body: BodyModel,
    proposals: tuple[Proposal, ...],
    ranges: JointRanges,
    *,
    neutral: FloatArray,
    near: float,
    samples: int,
    seed: int,
    model: Any,
    geometries: tuple[LinkGeometry, ...],
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[PairRecord, ...]:
    """A record of every pair that is more than one joint apart, in the order of the proposals.

    neutral: posture (nq,) that is looked at first. near: distance, m, that no search needs to go below. model:
    `mujoco.MjModel` of the body, with the geometries of the proposals. progress takes the share that is done.
    Deterministic by `seed`.
    """
    rng = np.random.default_rng(seed)
    pairs = _pairs(body, proposals)
    shapes = PlacedShapes(body, proposals)
    postures = np.concatenate([neutral[None], ranges.sample(rng, samples)])
    at_neutral = shapes.distances(neutral[None], pairs)[0]
    smallest, largest = at_neutral.copy(), at_neutral.copy()
    nearest, farthest = np.zeros(len(pairs), dtype=int), np.zeros(len(pairs), dtype=int)
    for first in range(0, len(postures), BLOCK):
        seen = shapes.distances(postures[first : first + BLOCK], pairs)
        nearest = np.where(seen.min(axis=0) < smallest, first + seen.argmin(axis=0), nearest)
        farthest = np.where(seen.max(axis=0) > largest, first + seen.argmax(axis=0), farthest)
        smallest, largest = np.minimum(smallest, seen.min(axis=0)), np.maximum(largest, seen.max(axis=0))
        progress(0.5 * first / len(postures))
    sign = np.where(smallest > near, 1.0, np.where(largest < 0.0, -1.0, 0.0))  # together, apart, or not searched
    for index in np.flatnonzero(sign):
        one, other = pairs[index].tolist()
        starts = ranges.sample(rng, SEARCHES)
        starts[0] = postures[nearest[index] if sign[index] > 0.0 else farthest[index]]
        moving = np.isin(ranges.links, list(body.links_between(proposals[one].link, proposals[other].link)))
        enough = near if sign[index] > 0.0 else 0.0
        found = search(shapes, ranges, (one, other), starts, moving=moving, sign=sign[index], enough=enough, rng=rng)
        if sign[index] > 0.0:
            smallest[index] = min(smallest[index], found)
        else:
            largest[index] = max(largest[index], -found)
        progress(0.5 + 0.5 * (index + 1) / len(pairs))
    overlapping: list[Pair] = [(one, other) for one, other in pairs[largest < 0.0].tolist()]
    own = _own_distances(model, overlapping, geometries, ranges, seed=seed)
    return tuple(
        PairRecord(
            pair=(one, other),
            smallest=float(smallest[index]),
            largest=float(largest[index]) if largest[index] < 0.0 else None,
            at_neutral=float(at_neutral[index]),
            samples=len(postures),
            searches=SEARCHES if sign[index] else 0,
            own=own.get((one, other)),
        )
        for index, (one, other) in enumerate(pairs.tolist())
    )


def _pairs(body: BodyModel, proposals: tuple[Proposal, ...]) -> IntArray:
    links = [proposal.link for proposal in proposals]
    found = [
        (first, second)
        for second in range(len(links))
        for first in range(second)
        if steps_between(body, links[first], links[second]) > 1
    ]
    return np.array(found, dtype=np.int64).reshape(-1, 2)


# How near the geoms of two links come themselves: whether a shape around them hides that they come apart.

SAMPLES = 2000
FAR = 1e3
"""[m]"""


def _own_distances(
    model: Any, pairs: list[Pair], geometries: tuple[LinkGeometry, ...], ranges: JointRanges, *, seed: int
) -> dict[Pair, tuple[float, float]]:
    """Smallest and largest distance of the own geoms of each pair of links in a sample. model: `mujoco.MjModel`."""
    import mujoco

    data = mujoco.MjData(model)
    geoms = [list(product(*(geometries[place].geoms for place in pair))) for pair in pairs]
    found = np.zeros((SAMPLES, len(pairs)))
    for row, q in enumerate(ranges.sample(np.random.default_rng(seed), SAMPLES if pairs else 0)):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        for column, both in enumerate(geoms):
            found[row, column] = min(mujoco.mj_geomDistance(model, data, a, b, FAR, None) for a, b in both)
    return {pair: (float(column.min()), float(column.max())) for pair, column in zip(pairs, found.T, strict=True)}
