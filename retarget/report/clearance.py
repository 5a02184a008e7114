"""Clearance of a body to itself and to a scene, on the geoms of its own file, by `mj_geomDistance`, because margins
distort the distances of contacts."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.model.body_file import BodyFile, Root, compile_body, compile_body_text
from retarget.model.robot import RobotBody
from retarget.model.scene_shapes import SceneShapes, ShapeKind, mujoco_geom
from retarget.model.scene_state import SceneState
from retarget.report.motion_metrics import blocks
from retarget.report.report import Clearances, DeepReport
from retarget.rotations import to_matrix
from retarget.run.run_result import RunResult
from retarget.types import MM, FloatArray, IntArray

Distances = Callable[[IntArray, IntArray], FloatArray]
"""Signed distances (m,), m, of pairs (m,) in postures (m,), in rising order."""
Bounds = Callable[[IntArray], FloatArray]
"""Lower bounds (m, P), m, of the distances of all pairs in postures (m,)."""

BOUND_ROUND_OFF_M = 1e-9
"""Round-off, m, of the bound of two balls."""


class ClosestPairs:
    """Finds the nearest pair over successive blocks of postures.

    tolerances: depths, m. smallest: distance, m, of `pair` in posture `row`. deeper: number of postures beyond each
    tolerance.
    """

    def __init__(self, tolerances: tuple[float, ...]) -> None:
        self._tolerances, self.deeper = tolerances, [0] * len(tolerances)
        self.smallest, self.row, self.pair, self._seen = np.inf, 0, 0, 0

    def look(self, distances: Distances, bounds: Bounds, count: int) -> None:
        """Look at the next `count` postures, which both functions number from 0."""
        if not count:
            return
        postures = np.arange(count)
        bound = bounds(postures) - BOUND_ROUND_OFF_M
        # First the pair with the least bound in each posture, then all that may be nearer, or deep.
        which = bound.argmin(axis=1)
        found = distances(postures, which)
        least = min(self.smallest, float(found.min()))
        rows, others = np.nonzero(bound < max([least, *(-depth for depth in self._tolerances)]))
        found = np.append(found, distances(rows, others))
        rows, which = np.append(postures, rows), np.append(which, others)
        nearest = np.full(count, np.inf)  # [m]
        np.minimum.at(nearest, rows, found)
        for number, depth in enumerate(self._tolerances):
            self.deeper[number] += int(np.count_nonzero(nearest < -depth))
        best = np.lexsort((which, rows, found))[0]
        if found[best] < self.smallest:
            self.smallest = float(found[best])
            self.row, self.pair = self._seen + int(rows[best]), int(which[best])
        self._seen += count


FAR_M = 1e4
"""Largest distance, m, that is measured."""


@dataclass(frozen=True, eq=False)
class MovingGeoms:
    """Geoms (g,) of a compiled model in T postures. geoms: ids; position (T, g, 3) m and row-major matrix (T, g, 9),
    world."""

    model: Any
    geoms: IntArray
    position: FloatArray
    matrix: FloatArray

    @property
    def links(self) -> IntArray:
        """Ids (g,) of their links."""
        return np.asarray(self.model.geom_bodyid)[self.geoms].astype(np.int64)

    def bounds(self, pairs: IntArray) -> Bounds:
        """Bounds of pairs (P, 2): the distance between bounding spheres, or of one from a plane."""
        first, second = pairs.T
        radius = np.asarray(self.model.geom_rbound)[self.geoms]
        radius = np.where(radius > 0.0, radius, np.inf)  # a plane has no end
        planes = np.flatnonzero(np.isinf(radius[second]))

        def bounds(rows: IntArray) -> FloatArray:
            place = self.position[rows]
            line = place[:, first] - place[:, second]
            apart = np.sqrt(np.einsum("rpi,rpi->rp", line, line)) - radius[second]
            normal = self.matrix[rows[:, None], second[planes], 2::3]
            apart[:, planes] = np.einsum("rpi,rpi->rp", line[:, planes], normal)
            return np.asarray(apart - radius[first])

        return bounds

    def distances(self, pairs: IntArray) -> Distances:
        """Distances of pairs (P, 2) of these geoms."""
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


def moving_geoms(model: Any, postures: FloatArray) -> MovingGeoms:
    """The geoms of `geoms_of_links` in postures (T, nq)."""
    import mujoco

    data, chosen = mujoco.MjData(model), geoms_of_links(model)
    position, matrix = np.empty((len(postures), model.ngeom, 3)), np.empty((len(postures), model.ngeom, 9))
    q, at, turned, kinematics = data.qpos, data.geom_xpos, data.geom_xmat, mujoco.mj_kinematics
    for row, posture in enumerate(postures):
        q[:] = posture
        kinematics(model, data)
        position[row] = at
        matrix[row] = turned
    return MovingGeoms(model, chosen, position[:, chosen], matrix[:, chosen])


def geoms_of_links(model: Any) -> IntArray:
    """Ids (g,) of each link's colliding geoms, or of all its geoms if none collides."""
    owner = np.asarray(model.geom_bodyid)
    collides = (np.asarray(model.geom_contype) | np.asarray(model.geom_conaffinity)) != 0
    return np.flatnonzero((owner > 0) & (collides | ~np.isin(owner, owner[collides])))


LINE_M = 1e-12
"""Radius, m, of a segment, because MuJoCo has no shapes without thickness."""


def among_obstacles(
    model: Any, obstacles: IntArray, geoms: MovingGeoms, scene: SceneState, times: FloatArray
) -> MovingGeoms:
    """The k obstacles of a scene, then the geoms (g,) of a body, at times (T,) s of the scene. model, obstacles: from
    `scene_model`."""
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
    """The model of a body with k obstacles, and the ids (k,) of their geoms. The ids of link geoms are k higher than in
    the body's own model."""
    spec = body.spec.copy()
    first = int(np.count_nonzero(np.asarray(body.model.geom_bodyid) == 0))
    for code, sizes in zip(shapes.kinds, shapes.sizes, strict=True):
        kind, size = mujoco_geom(ShapeKind(int(code)), sizes, thinnest=LINE_M)
        spec.worldbody.add_geom(type=kind, size=size)
    return spec.compile(), first + np.arange(len(shapes.names))


def compared_pairs(
    model: Any, links: IntArray, geoms: IntArray, *, neutral: FloatArray, ignored: Iterable[tuple[str, str]] = ()
) -> IntArray:
    """Rows (P, 2) of `links` and `geoms` (g,) that are compared.

    Left out are geoms of one link or of links without a joint between them, of a link and its parent, of excluded or
    `ignored` pairs, and of links that touch in the posture `neutral` (nq,).
    """
    never = _never_compared(model, ignored)
    pairs = np.column_stack(np.triu_indices(len(geoms), 1))
    first, second = links[pairs].T
    welded = np.asarray(model.body_weldid)[links[pairs]].T
    # Links on a fixed base are all welded to the world, and yet may meet.
    apart = (first != second) & ((welded[0] != welded[1]) | (welded[0] == 0)) & ~never[first, second]
    pairs = pairs[apart]
    first, second = links[pairs].T
    touching, met = _touching(model, geoms[pairs], neutral), np.zeros_like(never)
    met[first[touching], second[touching]] = met[second[touching], first[touching]] = True
    return np.asarray(pairs[~met[first, second]])


def _never_compared(model: Any, ignored: Iterable[tuple[str, str]]) -> NDArray[np.bool_]:
    weld, parent = np.asarray(model.body_weldid), np.asarray(model.body_parentid)
    # Links without a joint between them are all neighbours of the parent of their joint.
    above = weld[parent[weld]]
    never = (above[:, None] == weld) & (weld[:, None] != weld) & (weld != 0)
    never[np.arange(model.nbody), parent] = True
    excluded = np.asarray(model.exclude_signature, dtype=np.int64)
    never[excluded >> 16, excluded & 0xFFFF] = True
    for first, second in ignored:
        never[model.body(first).id, model.body(second).id] = True
    return np.asarray(never | never.T)


def _touching(model: Any, pairs: IntArray, q: FloatArray) -> NDArray[np.bool_]:
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    distances = [mujoco.mj_geomDistance(model, data, int(a), int(b), FAR_M, None) for a, b in pairs]
    return np.array(distances) <= 0.0


TOUCH_M = 1e-6
"""Depth, m, beyond which geoms penetrate."""
DEEP_M = 1e-3
"""Depth, m, beyond which it is more than a touch."""


@dataclass(frozen=True)
class Clearance:
    """smallest: distance, m, negative inside; None: nothing to compare. penetrating, deep: postures beyond TOUCH_M and
    DEEP_M. pair, row: the closest, and their posture."""

    smallest: float | None
    penetrating: int
    pair: tuple[str, str] | None
    row: int | None = None
    deep: int = 0


@dataclass(frozen=True, eq=False)
class PlacedBody:
    """A body in T postures (T, nq). rows (T,): their indices among those given. Geoms are placed block by block."""

    file: BodyFile
    postures: FloatArray
    rows: IntArray

    @property
    def model(self) -> Any:
        """The compiled `mujoco.MjModel`."""
        return self.file.model

    @property
    def geoms(self) -> IntArray:
        """Ids (g,) of the geoms that are compared."""
        return geoms_of_links(self.model)

    @property
    def links(self) -> IntArray:
        """Ids (g,) of their links."""
        return np.asarray(self.model.geom_bodyid)[self.geoms].astype(np.int64)

    def to_itself(self, *, neutral: FloatArray, ignored: Iterable[tuple[str, str]] = ()) -> Clearance:
        """Clearance of the pairs of `compared_pairs`."""
        pairs = compared_pairs(self.model, self.links, self.geoms, neutral=neutral, ignored=ignored)
        if not len(self.rows) or not len(pairs):
            return Clearance(None, 0, None)
        found = self._closest(pairs, lambda geoms, rows: geoms)
        first, second = (self._name(geom) for geom in pairs[found.pair])
        return self._clearance(found, (first, second))

    def to_scene(self, scene: SceneState, times: FloatArray) -> Clearance:
        """Clearance to every obstacle but the ground, at times (T,) s of the scene, one for each given posture."""
        return self._to_obstacles(scene, times, np.tile(~scene.shapes.ground, (len(self.links), 1)))

    def to_ground(self, scene: SceneState, times: FloatArray, *, feet: Iterable[str]) -> Clearance:
        """Clearance between the ground of the scene and all links but `feet`."""
        standing = [self.model.body(name).id for name in feet]
        return self._to_obstacles(scene, times, scene.shapes.ground & ~np.isin(self.links, standing)[:, None])

    def _to_obstacles(self, scene: SceneState, times: FloatArray, looks: NDArray[np.bool_]) -> Clearance:
        """looks (g, k): true where a geom is compared with an obstacle."""
        if not len(self.rows) or not looks.any():
            return Clearance(None, 0, None)
        pairs, names = np.argwhere(looks), scene.shapes.names
        model, obstacles = scene_model(self.file, scene.shapes)

        def both(geoms: MovingGeoms, rows: slice) -> MovingGeoms:
            return among_obstacles(model, obstacles, geoms, scene, times[self.rows[rows]])

        found = self._closest(pairs + np.array([len(names), 0]), both)
        link, obstacle = pairs[found.pair]
        return self._clearance(found, (self._name(link), names[obstacle]))

    def _closest(self, pairs: IntArray, seen: Callable[[MovingGeoms, slice], MovingGeoms]) -> ClosestPairs:
        """The nearest of pairs (P, 2). seen: adds obstacles to the body's geoms in some postures."""
        closest = ClosestPairs((TOUCH_M, DEEP_M))
        for rows in blocks(len(self.rows)):
            geoms = seen(moving_geoms(self.model, self.postures[rows]), rows)
            closest.look(geoms.distances(pairs), geoms.bounds(pairs), len(geoms.position))
        return closest

    def _clearance(self, found: ClosestPairs, pair: tuple[str, str]) -> Clearance:
        penetrating, deep = found.deeper
        return Clearance(found.smallest, penetrating, pair, int(self.rows[found.row]), deep)

    def _name(self, geom: int) -> str:
        return str(self.model.body(int(self.links[geom])).name)


def place_body(body: Path | str, postures: FloatArray, *, root: Root | None = None) -> PlacedBody:
    """The body of a file, or of our own MJCF text, in the finite ones of postures (T, nq). root: as in `compile_body`.
    Raises InputError."""
    if isinstance(body, Path):
        file = compile_body(body, root=root)
    else:
        file = compile_body_text(body, source="the body", root=root, own=True)
    rows = np.flatnonzero(np.isfinite(postures).all(axis=1))
    return PlacedBody(file, postures if len(rows) == len(postures) else postures[rows], rows)


NEUTRAL = "attractor"
"""The human's posture in which touching pairs are left out."""


NOTHING = Clearance(None, 0, None)  # no other body


def robot_clearances(
    robot: RobotBody, q: FloatArray, scene: SceneState | None, times: FloatArray
) -> tuple[Clearance, Clearance, Clearance]:
    """Clearance of a robot in postures (T, nq), at times (T,) s of the scene: to itself, to obstacles, and of links
    without a sole to the ground."""
    profile, placed = robot.profile, place_body(robot.profile.body_path, q, root=robot.profile.root)
    ignored, neutral = [entry.pair for entry in profile.ignore_pairs], robot.posture(profile.postures.neutral)
    to_itself = placed.to_itself(neutral=neutral, ignored=ignored)
    if scene is None:
        return to_itself, NOTHING, NOTHING
    feet = frozenset[str]().union(*(robot.foot_links if robot.on_floor else ()))
    return to_itself, placed.to_scene(scene, times), placed.to_ground(scene, times, feet=feet)


def clearances(run: RunResult) -> dict[str, Any]:
    """Clearance of the robot as sent, or else of the human, by the keys of the report. A tick that penetrates twice
    counts twice."""
    robot, sent, times = run.robot, run.record.robot, np.maximum(run.record.time, 0.0)
    if robot is not None and sent is not None:
        to_itself, to_scene, to_ground = robot_clearances(robot, sent.q, run.scene, times)
    else:
        placed = place_body(run.human.mjcf, run.record.human_q)
        to_itself, to_scene, to_ground = placed.to_itself(neutral=run.human.posture(NEUTRAL)), NOTHING, NOTHING
        if run.scene is not None:
            to_scene, to_ground = placed.to_scene(run.scene, times), placed.to_ground(run.scene, times, feet=())
    compared = [part for part in (to_itself, to_scene, to_ground) if part.smallest is not None]
    deep = sum(part.deep for part in compared) if compared else None
    return {
        "min_clearance_mm": Clearances(in_mm(to_itself.smallest), in_mm(to_scene.smallest), in_mm(to_ground.smallest)),
        "penetrating_frames": sum(part.penetrating for part in compared) if compared else None,
        "deep": DeepReport(deep, to_scene.pair, to_ground.pair),
        "closest_links": to_itself.pair,
    }


def in_mm(metres: float | None) -> float | None:
    """Metres in mm; None stays None."""
    return None if metres is None else MM * metres
