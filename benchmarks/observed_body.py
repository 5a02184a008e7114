"""A body that looks at itself: a benchmark's body, its collision observers, and how far they are from each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from benchmarks.bodies import BenchBody, Floats, bench_human, bench_op3
from retarget import _solver, rotations
from retarget.model.human import build_human
from retarget.model.human_dimensions import HumanDimensions, proportional_dimensions
from retarget.model.observers import Observers, human_observers, robot_observers
from retarget.model.robot import load_robot
from retarget.schema.priorities import load_priorities

Worn = Literal["lines_and_head", "capsules"]
SETTINGS = {"lines_and_head": "paper", "capsules": "human"}
"""The priority file whose influence and margin a human's observers take."""

Solids = tuple[NDArray[np.int64], Floats, Floats, Floats]
"""Kinds, sizes, positions and orientations, as `shape_distances` takes them."""


@dataclass(frozen=True, eq=False)
class Watched:
    """A body and what it observes itself with. first: what leads, ankles or observers. worn: in words."""

    body: BenchBody
    observers: Observers
    first: Literal["observers", "ankles"]
    worn: str


@dataclass(frozen=True, eq=False)
class StaticObstacles:
    """k obstacles at rest: kinds (k,) and sizes (k, 3) m as in `shape_distances`, position (k, 3) m, influence m."""

    kinds: NDArray[np.int64]
    sizes: Floats
    position: Floats
    influence: float

    @property
    def quat(self) -> Floats:
        """Orientations (k, 4) wxyz: along the world's axes."""
        return np.tile([1.0, 0.0, 0.0, 0.0], (len(self.kinds), 1))

    def leading(self, count: int) -> StaticObstacles:
        """The first `count` of them."""
        return StaticObstacles(self.kinds[:count], self.sizes[:count], self.position[:count], self.influence)


NOTHING = StaticObstacles(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3)), 0.1)


def watched_human(worn: Worn, dimensions: HumanDimensions | None = None) -> Watched:
    """The virtual human with the lines of the paper and a ball for the head, or with a capsule on every segment."""
    size = dimensions or proportional_dimensions(1.75)
    settings = load_priorities(SETTINGS[worn]).observers.model_copy(update={"human": worn})
    observers = human_observers(build_human(size), settings)
    assert observers is not None, "these are observers"
    label = f"{len(observers.names)} {'lines and head' if worn == 'lines_and_head' else worn}"
    return Watched(bench_human(size), observers, "ankles", label)


def watched_op3(body: BenchBody | None = None) -> Watched:
    """OP3 with the observers of its profile, every pair that is not ignored."""
    body = body or bench_op3()
    observers = robot_observers(load_robot("op3"))
    return Watched(body, observers, "observers", f"{len(observers.names)} boxes")


def placed_observers(watched: Watched, postures: Floats) -> tuple[Floats, Floats]:
    """World positions (T, n, 3) and orientations (T, n, 4) wxyz of the observers in postures (T, nq)."""
    body, seen = watched.body.model.solver_body(), watched.observers
    links = seen.links.tolist()
    quats = rotations.multiply(body.orientations(postures, links), seen.quats)
    return body.points(postures, links, seen.positions), quats


def exact_self_distances(watched: Watched, q: Floats) -> Floats:
    """Signed distance (p,) m of every pair in a posture (nq,), near or far."""
    seen, (position, quat) = watched.observers, placed_observers(watched, q[None])
    first, second = ((seen.kinds[k], seen.sizes[k], position[0, k], quat[0, k]) for k in seen.pairs.T)
    return _solver.shape_distances(*_packed(first), *_packed(second))[0]


def scene_distances(watched: Watched, postures: Floats, around: StaticObstacles) -> Floats:
    """Signed distance (T, n, k) m of every observer to every obstacle; beyond influence a bound, as above."""
    seen, (position, quat) = watched.observers, placed_observers(watched, postures)
    frames, n, k = len(postures), len(seen.names), len(around.kinds)
    mine = (
        np.tile(np.repeat(seen.kinds, k), frames),
        np.tile(np.repeat(seen.sizes, k, axis=0), (frames, 1)),
        np.repeat(position.reshape(-1, 3), k, axis=0),
        np.repeat(quat.reshape(-1, 4), k, axis=0),
    )
    theirs = (
        np.tile(around.kinds, frames * n),
        np.tile(around.sizes, (frames * n, 1)),
        np.tile(around.position, (frames * n, 1)),
        np.tile(around.quat, (frames * n, 1)),
    )
    zone = np.tile(np.repeat(np.maximum(seen.influence, around.influence), k), frames)
    return _distances(mine, theirs, zone).reshape(frames, n, k)


def _distances(first: Solids, second: Solids, zone: Floats) -> Floats:
    """Distances (N,) within a zone (N,) m, bounds beyond it: exact ones everywhere cost too much."""
    found = _solver.shape_gaps_at_least(*_packed(first), *_packed(second))
    near = np.flatnonzero(found <= zone)
    found[near] = _solver.shape_distances(*_packed(first, near), *_packed(second, near))[0]
    return found


def _packed(solids: Solids, rows: NDArray[np.int64] | slice = slice(None)) -> Solids:
    kinds, sizes, position, quat = solids
    return (
        np.ascontiguousarray(kinds[rows]),
        np.ascontiguousarray(sizes[rows]),
        np.ascontiguousarray(position[rows]),
        np.ascontiguousarray(quat[rows]),
    )
