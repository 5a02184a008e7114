"""Distances of geoms over many postures, and of obstacles, without a look at most pairs.

Signed distance changes by no more than the two shapes move (Hausdorff distance; inside as outside). So between two
postures a and b, in which a pair is d_a and d_b apart and which its shapes travel W in all between, it is never nearer
than (d_a + d_b - W) / 2. Where that might be the nearest, or inside, all postures in between are looked at.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.model.body_file import BodyFile
from retarget.model.scene_shapes import SceneShapes, ShapeKind
from retarget.model.scene_state import SceneState
from retarget.rotations import to_matrix
from retarget.schema.shapes import MAX_COORDINATE
from retarget.types import FloatArray, IntArray

Distances = Callable[[IntArray, IntArray], FloatArray]
"""Signed distances (m,) of pairs (m,) in postures (m,), m; the postures come in rising order."""


@dataclass(frozen=True, eq=False)
class Closest:
    """smallest: m, at `row` of `pair`, numbers of posture and pair. deeper: how many postures, for each tolerance."""

    smallest: float
    row: int
    pair: int
    deeper: tuple[int, ...]


STRIDE = 8
"""Postures from one that is looked at for every pair to the next. A body at 125 Hz moves some mm in between: then few
pairs are near enough for a second look, and an eighth of all looks is done in any case."""


def closest_pairs(distances: Distances, way: FloatArray, *, tolerances: tuple[float, ...]) -> Closest:
    """Look at pairs over postures; way (T, P): what the two shapes of each pair travelled since the first posture, m.

    tolerances: depths, m. Raises ValueError without postures or pairs.
    """
    count, pairs = way.shape
    if not count or not pairs:
        raise ValueError(f"nothing to compare: {count} postures, {pairs} pairs")
    seen = np.unique(np.append(np.arange(0, count, STRIDE), count - 1))
    rows, which = (index.ravel() for index in np.meshgrid(seen, np.arange(pairs), indexing="ij"))
    found = distances(rows, which)
    # Between two looks: only where a pair may be the nearest of all, or as deep as a tolerance.
    known = found.reshape(len(seen), pairs)
    bound = 0.5 * (known[:-1] + known[1:] - np.diff(way[seen], axis=0))
    span, pair = np.nonzero(bound < max(float(known.min()), *(-depth for depth in tolerances)))
    between = seen[span, None] + np.arange(1, STRIDE)
    inside = between < seen[span + 1, None]
    later, of_pair = between[inside], np.repeat(pair, STRIDE - 1).reshape(between.shape)[inside]
    order = np.argsort(later, kind="stable")
    found = np.append(found, distances(later[order], of_pair[order]))
    rows, which = np.append(rows, later[order]), np.append(which, of_pair[order])

    nearest = np.full(count, np.inf)  # (T,) [m]
    np.minimum.at(nearest, rows, found)
    least = np.flatnonzero(found == found.min())
    first = least[np.lexsort((which[least], rows[least]))[0]]
    deeper = tuple(int(np.count_nonzero(nearest < -depth)) for depth in tolerances)
    return Closest(float(found[first]), int(rows[first]), int(which[first]), deeper)


# MuJoCo's distance between two geoms of a model, wherever they are put.

FAR_M = 1e4
"""Distances are known up to this, m."""


def geom_distances(
    model: Any, pairs: IntArray, *, geoms: IntArray, position: FloatArray, matrix: FloatArray
) -> Distances:
    """Signed distances (m,) m of rows of `pairs` (P, 2), numbers of geoms, in postures (m,) that come in rising order.

    geoms (g,): which are put where; position (T, g, 3) m and matrix (T, g, 9), world, in T postures.
    """
    import mujoco

    data = mujoco.MjData(model)
    measure, first, second = mujoco.mj_geomDistance, pairs[:, 0], pairs[:, 1]
    at, turned = data.geom_xpos, data.geom_xmat
    places: IntArray | slice = geoms
    begin, end = int(geoms[0]), int(geoms[0]) + len(geoms)
    if np.array_equal(geoms, np.arange(begin, end)):  # the usual case: a slice is written faster than single rows
        places = slice(begin, end)

    def distances(rows: IntArray, which: IntArray) -> FloatArray:
        found: list[float] = []
        a, b = first[which].tolist(), second[which].tolist()
        begins = [0, *(np.flatnonzero(np.diff(rows)) + 1).tolist(), len(rows)]
        for begin, end in pairwise(begins):
            if begin < end:
                at[places], turned[places] = position[rows[begin]], matrix[rows[begin]]
                found += [
                    measure(model, data, i, j, FAR_M, None) for i, j in zip(a[begin:end], b[begin:end], strict=True)
                ]
        return np.array(found, dtype=float)

    return distances


# The geoms of a body over many postures: where each is, and how far it went.


@dataclass(frozen=True, eq=False)
class MovingGeoms:
    """g geoms in T postures. links (g,): numbers of their links; geoms (g,): their own numbers in the model.

    position (T, g, 3) m and matrix (T, g, 9), world, rows of the rotation one after the other; radius (g,) m of a ball
    about the position that holds the geom.
    """

    links: NDArray[np.int64]
    geoms: NDArray[np.int64]
    position: FloatArray
    matrix: FloatArray
    radius: FloatArray

    def within(self, base: int) -> "MovingGeoms":
        """The same, seen from the geom `base`, whose own motion then takes no part."""
        back = self.matrix[:, base].reshape(-1, 1, 3, 3).swapaxes(-1, -2)  # R_base_world
        position = (back @ (self.position - self.position[:, base, None])[..., None])[..., 0]
        matrix = back @ self.matrix.reshape(*self.matrix.shape[:2], 3, 3)
        return MovingGeoms(self.links, self.geoms, position, matrix.reshape(self.matrix.shape), self.radius)


def moving_geoms(model: Any, postures: FloatArray) -> MovingGeoms:
    """The geoms of every link of a compiled body, but not those of the world, in postures (T, nq)."""
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
    return MovingGeoms(
        links=np.asarray(model.geom_bodyid)[chosen].astype(np.int64),
        geoms=chosen,
        position=position[:, chosen],
        matrix=matrix[:, chosen],
        radius=np.asarray(model.geom_rbound)[chosen].copy(),
    )


def travelled(position: FloatArray, matrix: FloatArray, radius: FloatArray) -> FloatArray:
    """Upper bound (T, g) m of the way that any point of each geom went since the first posture.

    Between two postures no point goes farther than |c1 - c0| + r ||R1 - R0||, and ||R1 - R0|| is the Frobenius norm
    over sqrt(2): both singular values of the difference of two rotations that are not zero are equal.
    """
    shift = np.linalg.norm(np.diff(position, axis=0), axis=-1)
    turn = np.sqrt(0.5) * np.linalg.norm(np.diff(matrix, axis=0), axis=-1)
    return np.vstack([np.zeros((1, position.shape[1])), np.cumsum(shift + radius * turn, axis=0)])


# Obstacles of a scene among the geoms of a body, in one MuJoCo model.

LINE_M = 1e-12
"""Radius, m, of a segment: MuJoCo has no shapes without thickness."""
EVERYWHERE = 1.0
"""Size of a half-space's plane; a plane has no end, whatever is said."""


def scene_model(body: BodyFile, shapes: SceneShapes) -> tuple[Any, IntArray]:
    """The model of a body with k obstacles, and the numbers (k,) of their geoms in it. They are the last ones of the
    world, so that each geom of a link has a number higher by k than in the body's own model."""
    import mujoco

    spec = body.spec.copy()
    first = int(np.count_nonzero(np.asarray(body.model.geom_bodyid) == 0))
    for code, sizes in zip(shapes.kinds, shapes.sizes, strict=True):
        kind, size = primitive(mujoco, ShapeKind(int(code)), sizes)
        spec.worldbody.add_geom(type=kind, size=size)
    return spec.compile(), first + np.arange(len(shapes.names))


def obstacle_tracks(scene: SceneState, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position (T, k, 3) m and matrix (T, k, 9), world, of the obstacles at times (T,), s on the clock of the scene,
    and the radius (k,) m of a ball about each."""
    count = len(scene.shapes.names)
    position, quat = np.empty((len(times), count, 3)), np.empty((len(times), count, 4))
    for row, time in enumerate(times):
        poses = scene.at(float(time))
        position[row], quat[row] = poses.position, poses.quat
    return position, to_matrix(quat).reshape(len(times), count, 9), _radii(scene.shapes)


def _radii(shapes: SceneShapes) -> FloatArray:
    """Radii (k,) of balls about the obstacles, m."""
    radius = np.linalg.norm(shapes.sizes, axis=1)
    capsules, planes = shapes.kinds == ShapeKind.CAPSULE, shapes.kinds == ShapeKind.HALF_SPACE
    radius[capsules] = shapes.sizes[capsules].sum(axis=1)
    radius[planes] = MAX_COORDINATE
    return np.asarray(radius)


def primitive(mujoco: Any, kind: ShapeKind, sizes: FloatArray) -> tuple[Any, list[float]]:
    """MuJoCo's type and size of a canonical shape."""
    types, (first, second, third) = mujoco.mjtGeom, sizes.tolist()
    if kind is ShapeKind.CAPSULE:
        if second == 0.0:
            return types.mjGEOM_SPHERE, [first, 0.0, 0.0]
        return types.mjGEOM_CAPSULE, [max(first, LINE_M), second, 0.0]
    if kind is ShapeKind.CYLINDER:
        return types.mjGEOM_CYLINDER, [first, second, 0.0]
    if kind is ShapeKind.BOX:
        return types.mjGEOM_BOX, [first, second, third]
    return types.mjGEOM_PLANE, [EVERYWHERE] * 3
