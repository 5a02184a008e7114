"""Distances of geoms over many postures, and of obstacles, without a look at most pairs.

Signed distance changes by no more than the two shapes move (Hausdorff distance; inside as outside). So between two
postures a and b, in which a pair is d_a and d_b apart and which its shapes travel W in all between, it is never nearer
than (d_a + d_b - W) / 2. Where that might be the nearest, or inside, the posture in the middle is looked at.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    if np.array_equal(geoms, np.arange(len(geoms))):  # the usual case: a slice is written faster than single rows
        at, turned, places = at[: len(geoms)], turned[: len(geoms)], slice(None)

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

    def chosen(self, rows: NDArray[np.int64], which: NDArray[np.int64]) -> "MovingGeoms":
        """Some of the geoms in some of the postures, by number."""
        return MovingGeoms(
            self.links[which],
            self.geoms[which],
            self.position[rows][:, which],
            self.matrix[rows][:, which],
            self.radius[which],
        )

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


# Obstacles of a scene and the geoms of a body, in one MuJoCo model that measures distances and nothing else.

LINE_M = 1e-12
"""Radius, m, of a segment: MuJoCo has no shapes without thickness."""
EVERYWHERE = 1.0
"""Size of a half-space's plane; a plane has no end, whatever is said."""


@dataclass(frozen=True, eq=False)
class SceneModel:
    """model: geoms without links. body (g,) and obstacles (k,): numbers of the geoms.

    shift (g, 3) m, turn (g, 3, 3): where each geom's frame is in that of the body's own model. A mesh is laid anew
    along its axes when it is compiled.
    """

    model: Any
    body: NDArray[np.int64]
    obstacles: NDArray[np.int64]
    shift: FloatArray
    turn: FloatArray

    def placed(self, geoms: MovingGeoms) -> tuple[FloatArray, FloatArray]:
        """Positions (T, g, 3) m and matrices (T, g, 9), world, of the geoms of the body in this model."""
        turn = geoms.matrix.reshape(*geoms.matrix.shape[:2], 3, 3)
        position = geoms.position + (turn @ self.shift[..., None])[..., 0]
        return position, (turn @ self.turn).reshape(geoms.matrix.shape)


@dataclass(frozen=True, eq=False)
class ObstacleTracks:
    """k obstacles at T times: position (T, k, 3) m and matrix (T, k, 9), world; radius (k,) m as of `MovingGeoms`."""

    position: FloatArray
    matrix: FloatArray
    radius: FloatArray


def scene_model(source: Any, geoms: NDArray[np.int64], shapes: SceneShapes) -> SceneModel:
    """Copy `geoms` (g,) of the compiled model `source`, and add the obstacles."""
    import mujoco

    spec = mujoco.MjSpec()
    for number, geom in enumerate(geoms):
        size, kind, mesh = source.geom_size[geom], source.geom_type[geom], source.geom_dataid[geom]
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            begin, count = source.mesh_vertadr[mesh], source.mesh_vertnum[mesh]
            vertices = source.mesh_vert[begin : begin + count]
            spec.add_mesh(name=f"mesh {number}", uservert=vertices.ravel().tolist())
            spec.worldbody.add_geom(name=f"body {number}", type=kind, meshname=f"mesh {number}")
        else:
            spec.worldbody.add_geom(name=f"body {number}", type=kind, size=size)
    for number, (code, sizes) in enumerate(zip(shapes.kinds, shapes.sizes, strict=True)):
        kind, size = _primitive(mujoco, ShapeKind(int(code)), sizes)
        spec.worldbody.add_geom(name=f"obstacle {number}", type=kind, size=size)
    model = spec.compile()
    body = np.array([model.geom(f"body {k}").id for k in range(len(geoms))], dtype=np.int64)
    obstacles = np.array([model.geom(f"obstacle {k}").id for k in range(len(shapes.names))], dtype=np.int64)
    return SceneModel(model, body, obstacles, *_laid_anew(mujoco, model, body))


def obstacle_tracks(scene: SceneState, times: FloatArray) -> ObstacleTracks:
    """Where the obstacles are at times (T,), s on the clock of the scene."""
    count = len(scene.shapes.names)
    position, quat = np.empty((len(times), count, 3)), np.empty((len(times), count, 4))
    for row, time in enumerate(times):
        poses = scene.at(float(time))
        position[row], quat[row] = poses.position, poses.quat
    return ObstacleTracks(position, to_matrix(quat).reshape(len(times), count, 9), _radii(scene.shapes))


def _radii(shapes: SceneShapes) -> FloatArray:
    """Radii (k,) of balls about the obstacles, m."""
    radius = np.linalg.norm(shapes.sizes, axis=1)
    capsules, planes = shapes.kinds == ShapeKind.CAPSULE, shapes.kinds == ShapeKind.HALF_SPACE
    radius[capsules] = shapes.sizes[capsules].sum(axis=1)
    radius[planes] = MAX_COORDINATE
    return np.asarray(radius)


def _primitive(mujoco: Any, kind: ShapeKind, sizes: FloatArray) -> tuple[Any, list[float]]:
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


def _laid_anew(mujoco: Any, model: Any, geoms: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
    """Frames (g, 3) m and (g, 3, 3) of the geoms in the frames that they were copied from."""
    shift, turn = np.zeros((len(geoms), 3)), np.tile(np.eye(3), (len(geoms), 1, 1))
    for k, geom in enumerate(geoms):
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            mesh, matrix = model.geom_dataid[geom], np.zeros(9)
            mujoco.mju_quat2Mat(matrix, model.mesh_quat[mesh])
            shift[k], turn[k] = model.mesh_pos[mesh], matrix.reshape(3, 3)
    return shift, turn
