"""Where the obstacles of the benchmark stand: around the arms."""

from __future__ import annotations

import numpy as np

from benchmarks.bodies import Floats
from benchmarks.observed_body import StaticObstacles, Watched, placed_observers, scene_distances
from retarget.model.scene_shapes import ShapeKind

ARMS = {"human": ("shoulder", "elbow"), "op3": ("upper_arm", "forearm")}
"""Observers of an arm, each side."""
SEED = 5
EVERY = 10
"""Frames apart at which obstacles are compared with a motion."""
NEAR, FAR = (0.2, 0.8), (1.5, 4.0)
"""Shares of the influence at which an obstacle stays all the time, within it and beyond it."""


def influence(watched: Watched) -> float:
    """Of an obstacle, m: as far as observers look at each other."""
    return float(watched.observers.influence.max())


def size_of(watched: Watched) -> float:
    """Radius of an obstacle, m: about that of a forearm."""
    return 0.05 if watched.body.name == "human" else 0.02


def around_arms(watched: Watched, postures: Floats, count: int) -> StaticObstacles:
    """Spheres and boxes around both arms, by turns within influence in all of the postures (T, nq) and beyond it."""
    rng, zone = np.random.default_rng(SEED), influence(watched)
    seen = np.ascontiguousarray(postures[::EVERY])
    near: list[StaticObstacles] = []
    far: list[StaticObstacles] = []
    while min(len(near), len(far)) < (count + 1) // 2:
        tried = _candidates(rng, watched, seen[0], 16 * count)
        distance = scene_distances(watched, seen, tried).min(axis=1) / zone  # (T, k): of the nearest observer
        for kept, (least, most) in ((near, NEAR), (far, FAR)):
            fits = np.flatnonzero((distance.min(axis=0) >= least) & (distance.max(axis=0) <= most))
            kept += [_only(tried, k) for k in fits.tolist()]
    turns = [one for pair in zip(near, far, strict=False) for one in pair][:count]
    return StaticObstacles(
        kinds=np.concatenate([one.kinds for one in turns]),
        sizes=np.vstack([one.sizes for one in turns]),
        position=np.vstack([one.position for one in turns]),
        influence=zone,
    )


def _candidates(rng: np.random.Generator, watched: Watched, q: Floats, count: int) -> StaticObstacles:
    """Spheres and cubes by turns, somewhere around the observers of the arms in a posture (nq,)."""
    names = watched.observers.names
    arms = [k for k, name in enumerate(names) if name[2:] in ARMS[watched.body.name]]
    centres = placed_observers(watched, q[None])[0][0, arms]
    radius = size_of(watched)
    reach = FAR[1] * influence(watched) + 2.0 * radius
    kinds = np.where(np.arange(count) % 2 == 0, ShapeKind.CAPSULE, ShapeKind.BOX).astype(np.int64)
    sizes = np.where((kinds == ShapeKind.BOX)[:, None], 0.6 * radius, [[radius, 0.0, 0.0]])
    position = centres[rng.integers(len(arms), size=count)] + rng.uniform(-reach, reach, size=(count, 3))
    return StaticObstacles(kinds, sizes, position, influence(watched))


def _only(around: StaticObstacles, k: int) -> StaticObstacles:
    one = slice(k, k + 1)
    return StaticObstacles(around.kinds[one], around.sizes[one], around.position[one], around.influence)
