"""Distances of geoms over many postures, and of obstacles, without a look at most pairs.

Two shapes are never nearer than the balls about them, whose distance costs next to nothing. Where that leaves it open
whether a pair is the nearest, or inside, the shapes themselves are looked at.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from retarget.model.body_file import BodyFile
from retarget.model.scene_shapes import SceneShapes, ShapeKind, mujoco_geom
from retarget.model.scene_state import SceneState
from retarget.rotations import to_matrix
from retarget.types import FloatArray, IntArray

Distances = Callable[[IntArray, IntArray], FloatArray]
"""Signed distances (m,) of pairs (m,) in postures (m,), m; the postures come in rising order."""
Bounds = Callable[[IntArray], FloatArray]
"""What the signed distances (m, P) of all pairs in postures (m,) are never below, m."""

BLOCK = 1024
"""Postures that are looked at together, which bounds the memory."""
ROUND_OFF_M = 1e-9
"""The distance of two balls may be below its own bound by less than this."""


@dataclass(frozen=True, eq=False)
class Closest:
    """smallest: m, at `row` of `pair`, numbers of posture and pair. deeper: how many postures, for each tolerance."""

    smallest: float
    row: int
    pair: int
    deeper: tuple[int, ...]


def closest_pairs(distances: Distances, bounds: Bounds, count: int, *, tolerances: tuple[float, ...]) -> Closest:
    """The pair that comes nearest in `count` postures, the first where several do. tolerances: depths, m."""
    smallest, at = np.inf, (0, 0)
    nearest = np.full(count, np.inf)  # (T,) [m]
    for begin in range(0, count, BLOCK):
        postures = np.arange(begin, min(begin + BLOCK, count))
        bound = bounds(postures) - ROUND_OFF_M
        # First the pair of each posture that may be nearest; then all that may be nearer, or deep.
        which = bound.argmin(axis=1)
        found = distances(postures, which)
        least = min(smallest, float(found.min()))
        rows, others = np.nonzero(bound < max([least, *(-depth for depth in tolerances)]))
        found = np.append(found, distances(postures[rows], others))
        rows, which = np.append(postures, postures[rows]), np.append(which, others)
        np.minimum.at(nearest, rows, found)
        best = np.lexsort((which, rows, found))[0]
        if found[best] < smallest:
            smallest, at = float(found[best]), (int(rows[best]), int(which[best]))
    return Closest(smallest, *at, tuple(int(np.count_nonzero(nearest < -depth)) for depth in tolerances))


# The geoms of a body over many postures, and MuJoCo's distance between two of them.

FAR_M = 1e4
"""Distances are known up to this, m."""


@dataclass(frozen=True, eq=False)
class MovingGeoms:
    """g geoms of a compiled model in T postures. geoms (g,): their numbers in it; position (T, g, 3) m and matrix
    (T, g, 9), world, rows of the rotation one after the other."""

    model: Any
    geoms: IntArray
    position: FloatArray
    matrix: FloatArray

    @property
    def links(self) -> IntArray:
        """Numbers (g,) of the links that they are on."""
        return np.asarray(self.model.geom_bodyid)[self.geoms].astype(np.int64)

    def bounds(self, pairs: IntArray) -> Bounds:
        """Lower bounds, m, for pairs (P, 2) of these geoms: the distance of the balls about them, or of a ball from a
        plane."""
        first, second = pairs.T
        radius = np.asarray(self.model.geom_rbound)[self.geoms]
        radius = np.where(radius > 0.0, radius, np.inf)  # a plane has no end
        planes = np.flatnonzero(np.isinf(radius[second]))

        def bounds(rows: IntArray) -> FloatArray:
            place = self.position[rows]
            way = place[:, first] - place[:, second]
            apart = np.sqrt(np.einsum("rpi,rpi->rp", way, way)) - radius[second]
            normal = self.matrix[rows[:, None], second[planes], 2::3]
            apart[:, planes] = np.einsum("rpi,rpi->rp", way[:, planes], normal)
            return np.asarray(apart - radius[first])

        return bounds

    def distances(self, pairs: IntArray) -> Distances:
        """How the distances of pairs (P, 2) of these geoms are measured."""
        import mujoco

        model, data, measure = self.model, mujoco.MjData(self.model), mujoco.mj_geomDistance
        first, second = self.geoms[pairs].T
        at, turned = data.geom_xpos, data.geom_xmat

        def distances(rows: IntArray, which: IntArray) -> FloatArray:
            found: list[float] = []
            a, b = first[which].tolist(), second[which].tolist()
            begins = [0, *(np.flatnonzero(np.diff(rows)) + 1).tolist(), len(rows)]
            for begin, end in pairwise(begins):
                if begin < end:
                    at[self.geoms], turned[self.geoms] = self.position[rows[begin]], self.matrix[rows[begin]]
                    found += [
                        measure(model, data, i, j, FAR_M, None) for i, j in zip(a[begin:end], b[begin:end], strict=True)
                    ]
            return np.array(found, dtype=float)

        return distances

    def closest(self, pairs: IntArray, *, tolerances: tuple[float, ...]) -> Closest:
        """Find the nearest of pairs (P, 2), with its distance, m."""
        return closest_pairs(self.distances(pairs), self.bounds(pairs), len(self.position), tolerances=tolerances)


def moving_geoms(model: Any, postures: FloatArray) -> MovingGeoms:
    """Place the geoms of every link of a compiled body, but not those of the world, in postures (T, nq), m, wxyz and
    rad."""
    import mujoco

    data = mujoco.MjData(model)
    chosen = np.flatnonzero(np.asarray(model.geom_bodyid) > 0)
    position, matrix = np.empty((len(postures), model.ngeom, 3)), np.empty((len(postures), model.ngeom, 9))
    q, at, turned, kinematics = data.qpos, data.geom_xpos, data.geom_xmat, mujoco.mj_kinematics
    for row, posture in enumerate(postures):
        q[:] = posture
        kinematics(model, data)
        position[row] = at
        matrix[row] = turned
    return MovingGeoms(model, chosen, position[:, chosen], matrix[:, chosen])


# Obstacles of a scene among the geoms of a body, in one MuJoCo model.

LINE_M = 1e-12
"""Radius, m, of a segment: MuJoCo has no shapes without thickness."""


def among_obstacles(body: BodyFile, geoms: MovingGeoms, scene: SceneState, times: FloatArray) -> MovingGeoms:
    """The k obstacles of a scene, then the geoms (g,) of a body, at times (T,) s on the clock of the scene."""
    model, obstacles = scene_model(body, scene.shapes)
    count = len(obstacles)
    position, quat = np.empty((len(times), count, 3)), np.empty((len(times), count, 4))
    for row, time in enumerate(times):
        poses = scene.at(float(time))
        position[row], quat[row] = poses.position, poses.quat
    return MovingGeoms(
        model,
        np.concatenate([obstacles, geoms.geoms + count]),
        np.concatenate([position, geoms.position], axis=1),
        np.concatenate([to_matrix(quat).reshape(len(times), count, 9), geoms.matrix], axis=1),
    )


def scene_model(body: BodyFile, shapes: SceneShapes) -> tuple[Any, IntArray]:
    """The model of a body with k obstacles, and the numbers (k,) of their geoms in it. They are the last ones of the
    world, so that each geom of a link has a number higher by k than in the body's own model."""
    spec = body.spec.copy()
    first = int(np.count_nonzero(np.asarray(body.model.geom_bodyid) == 0))
    for code, sizes in zip(shapes.kinds, shapes.sizes, strict=True):
        kind, size = mujoco_geom(ShapeKind(int(code)), sizes, thinnest=LINE_M)
        spec.worldbody.add_geom(type=kind, size=size)
    return spec.compile(), first + np.arange(len(shapes.names))
