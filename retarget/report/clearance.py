"""How close a body came to itself and to a scene, on the geoms of its own file: an independent look at what was sent.

Distances are MuJoCo's own between two geoms (exact, inside too), not those of its contacts, which a margin distorts.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget import _solver
from retarget.model.body import BodyModel
from retarget.model.body_file import BodyFile, Root, compile_body, compile_body_text
from retarget.model.observers import Observers, placed
from retarget.model.robot import RobotBody
from retarget.model.scene_shapes import SceneShapes, ShapeKind, mujoco_geom
from retarget.model.scene_state import SceneState
from retarget.report.motion_metrics import blocks
from retarget.report.report import Clearances, DeepReport
from retarget.rotations import to_matrix
from retarget.run.run_result import RunResult
from retarget.types import MM, FloatArray, IntArray

# Distances of geoms over many postures, and of obstacles, without a look at most pairs.

Distances = Callable[[IntArray, IntArray], FloatArray]
"""Signed distances (m,) of pairs (m,) in postures (m,), m; the postures come in rising order."""
Bounds = Callable[[IntArray], FloatArray]
"""What the signed distances (m, P) of all pairs in postures (m,) are never below, m."""

ROUND_OFF_M = 1e-9
"""The distance of two balls may be below its own bound by less than this."""


@dataclass(frozen=True, eq=False)
class Closest:
    """smallest: m, at `row` of `pair`, numbers of posture and pair. deeper: how many postures, for each tolerance."""

    smallest: float
    row: int
    pair: int
    deeper: tuple[int, ...]


class ClosestPairs:
    """Finds the pair that comes nearest, the first where several do, over blocks of postures that come one after the
    other. tolerances: depths, m."""

    def __init__(self, tolerances: tuple[float, ...]) -> None:
        self._tolerances, self._deeper = tolerances, [0] * len(tolerances)
        self._smallest, self._at, self._seen = np.inf, (0, 0), 0

    def look(self, distances: Distances, bounds: Bounds, count: int) -> None:
        """Look at the next `count` postures, which both functions number from 0."""
        for rows in blocks(count):
            self._look(distances, bounds, np.arange(count)[rows])
        self._seen += count

    @property
    def found(self) -> Closest:
        """The nearest pair so far."""
        return Closest(self._smallest, *self._at, tuple(self._deeper))

    def _look(self, distances: Distances, bounds: Bounds, postures: IntArray) -> None:
        if not len(postures):
            return
        bound = bounds(postures) - ROUND_OFF_M
        # First the pair of each posture that may be nearest; then all that may be nearer, or deep.
        which = bound.argmin(axis=1)
        found = distances(postures, which)
        least = min(self._smallest, float(found.min()))
        rows, others = np.nonzero(bound < max([least, *(-depth for depth in self._tolerances)]))
        found = np.append(found, distances(postures[rows], others))
        rows, which = np.append(np.arange(len(postures)), rows), np.append(which, others)
        nearest = np.full(len(postures), np.inf)  # [m]
        np.minimum.at(nearest, rows, found)
        for number, depth in enumerate(self._tolerances):
            self._deeper[number] += int(np.count_nonzero(nearest < -depth))
        best = np.lexsort((which, rows, found))[0]
        if found[best] < self._smallest:
            self._smallest = float(found[best])
            self._at = (self._seen + int(postures[rows[best]]), int(which[best]))


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
        """Of pairs (P, 2) of these geoms: the distance of the balls about them, or of a ball from a plane."""
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


def moving_geoms(model: Any, postures: FloatArray) -> MovingGeoms:
    """The geoms of every link of a compiled body, but not those of the world, in postures (T, nq)."""
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
    """Numbers (g,) of the geoms of every link of a compiled body, but not those of the world."""
    return np.flatnonzero(np.asarray(model.geom_bodyid) > 0)


# Obstacles of a scene among the geoms of a body, in one MuJoCo model.

LINE_M = 1e-12
"""Radius, m, of a segment: MuJoCo has no shapes without thickness."""


def among_obstacles(
    model: Any, obstacles: IntArray, geoms: MovingGeoms, scene: SceneState, times: FloatArray
) -> MovingGeoms:
    """The k obstacles of a scene, then the geoms (g,) of a body, at times (T,) s on the clock of the scene. model,
    obstacles: of `scene_model`."""
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


# Which geoms of a body are compared with each other.

Pair = tuple[int, int]


def compared_pairs(
    model: Any, links: IntArray, geoms: IntArray, *, neutral: FloatArray, ignored: Iterable[tuple[str, str]] = ()
) -> IntArray:
    """Find the rows (P, 2) of `links` and `geoms` (g,) that are compared.

    Not compared: geoms of one link, or of links that no joint parts; of a link and its parent; of pairs that the file
    excludes; of `ignored` pairs of links; of pairs of links that touch in the posture `neutral` (nq,).
    """
    never = _never_compared(model, ignored)
    first, second = np.triu_indices(len(geoms), 1)
    welded = np.asarray(model.body_weldid)[links]
    apart = links[first] != links[second]
    # Links on a base that is fixed to the world are all welded to it, and yet may meet.
    apart &= (welded[first] != welded[second]) | (welded[first] == 0)
    pairs = np.column_stack([first, second])[apart]
    named = np.array([_pair(links[a], links[b]) not in never for a, b in pairs], dtype=np.bool_)
    pairs = pairs[named]
    touching = {_pair(a, b) for a, b in links[pairs[_touching(model, geoms[pairs], neutral)]]}
    kept = np.array([_pair(links[a], links[b]) not in touching for a, b in pairs], dtype=np.bool_)
    return np.asarray(pairs[kept])


def _never_compared(model: Any, ignored: Iterable[tuple[str, str]]) -> set[Pair]:
    """Pairs of links that are left out whatever the neutral posture is."""
    weld, parent = np.asarray(model.body_weldid), np.asarray(model.body_parentid)
    never = set()
    for link in range(1, model.nbody):
        never.add(_pair(link, parent[link]))
        # Of links that no joint parts, all are neighbours of what the joint hangs on.
        for other in range(1, model.nbody):
            if weld[other] and weld[link] != weld[other] and weld[parent[weld[link]]] == weld[other]:
                never.add(_pair(link, other))
    for signature in model.exclude_signature:
        never.add(_pair(int(signature) >> 16, int(signature) & 0xFFFF))
    for first, second in ignored:
        never.add(_pair(model.body(first).id, model.body(second).id))
    return never


def _touching(model: Any, pairs: IntArray, q: FloatArray) -> NDArray[np.bool_]:
    """Which pairs (P, 2) of geoms touch in a posture (nq,)."""
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    distances = [mujoco.mj_geomDistance(model, data, int(a), int(b), FAR_M, None) for a, b in pairs]
    return np.array(distances) <= 0.0


def _pair(first: int, second: int) -> Pair:
    return (int(min(first, second)), int(max(first, second)))


TOUCH_M = 1e-6
"""Deeper than this, m, counts as penetration."""
DEEP_M = 1e-3
"""Deeper than this, m, is more than a touch."""


@dataclass(frozen=True)
class Clearance:
    """smallest: distance, m, negative inside; None: nothing to compare. penetrating: number of postures.

    pair: the two links, or the link and the obstacle, that came closest; row: in which posture. deep: how many of the
    penetrating postures are deeper than 1 mm.
    """

    smallest: float | None
    penetrating: int
    pair: tuple[str, str] | None
    row: int | None = None
    deep: int = 0

    @property
    def deepest(self) -> float:
        """Depth of the deepest penetration, m; 0 without one."""
        return max(0.0, -(self.smallest or 0.0))


@dataclass(frozen=True, eq=False)
class PlacedBody:
    """A body in T postures (T, nq), to be looked at in more than one way. rows (T,): their numbers among those given.

    Its geoms are placed for a block of postures at a time: of all of them they need 100 bytes for each geom and tick.
    """

    file: BodyFile
    postures: FloatArray
    rows: IntArray

    @property
    def model(self) -> Any:
        """The compiled `mujoco.MjModel`."""
        return self.file.model

    @property
    def geoms(self) -> IntArray:
        """Numbers (g,) of the geoms that are looked at."""
        return geoms_of_links(self.model)

    @property
    def links(self) -> IntArray:
        """Numbers (g,) of the links that they are on."""
        return np.asarray(self.model.geom_bodyid)[self.geoms].astype(np.int64)

    def to_itself(self, *, neutral: FloatArray, ignored: Iterable[tuple[str, str]] = ()) -> Clearance:
        """Measure the clearance (m) of the body to itself. `compared_pairs` says which links are compared."""
        pairs = compared_pairs(self.model, self.links, self.geoms, neutral=neutral, ignored=ignored)
        if not len(self.rows) or not len(pairs):
            return Clearance(None, 0, None)
        found = self._closest(pairs, lambda geoms, rows: geoms)
        first, second = (self._name(geom) for geom in pairs[found.pair])
        return self._clearance(found, (first, second))

    def to_scene(self, scene: SceneState, times: FloatArray) -> Clearance:
        """Measure the clearance (m) between every geom and every obstacle of a scene but the ground, at times (T,) s on
        its clock: one for every posture that was given."""
        return self._to_obstacles(scene, times, np.tile(~scene.shapes.ground, (len(self.links), 1)))

    def to_ground(self, scene: SceneState, times: FloatArray, *, feet: Iterable[str]) -> Clearance:
        """Measure the clearance (m) between the ground of the scene and all links but those named in `feet`."""
        standing = [self.model.body(name).id for name in feet]
        return self._to_obstacles(scene, times, scene.shapes.ground & ~np.isin(self.links, standing)[:, None])

    def _to_obstacles(self, scene: SceneState, times: FloatArray, looks: NDArray[np.bool_]) -> Clearance:
        """looks (g, k): which geom is compared with which obstacle."""
        if not len(self.rows) or not looks.any():
            return Clearance(None, 0, None)
        pairs, names = np.argwhere(looks), scene.shapes.names
        model, obstacles = scene_model(self.file, scene.shapes)

        def both(geoms: MovingGeoms, rows: slice) -> MovingGeoms:
            return among_obstacles(model, obstacles, geoms, scene, times[self.rows[rows]])

        found = self._closest(pairs + np.array([len(names), 0]), both)
        link, obstacle = pairs[found.pair]
        return self._clearance(found, (self._name(link), names[obstacle]))

    def _closest(self, pairs: IntArray, seen: Callable[[MovingGeoms, slice], MovingGeoms]) -> Closest:
        """The nearest of pairs (P, 2) of what is `seen` of the body's geoms in some of the postures."""
        closest = ClosestPairs((TOUCH_M, DEEP_M))
        for rows in blocks(len(self.rows)):
            geoms = seen(moving_geoms(self.model, self.postures[rows]), rows)
            closest.look(geoms.distances(pairs), geoms.bounds(pairs), len(geoms.position))
        return closest.found

    def _clearance(self, found: Closest, pair: tuple[str, str]) -> Clearance:
        penetrating, deep = found.deeper
        return Clearance(found.smallest, penetrating, pair, int(self.rows[found.row]), deep)

    def _name(self, geom: int) -> str:
        """Name of the geom's link."""
        return str(self.model.body(int(self.links[geom])).name)


def place_body(body: Path | str, postures: FloatArray, *, root: Root | None = None) -> PlacedBody:
    """Place the body of a file, or of MJCF text that this program has made, in postures (T, nq), m, wxyz and rad; those
    that are not finite take no part.

    root: as in `compile_body`. Raises InputError.
    """
    if isinstance(body, Path):
        file = compile_body(body, root=root)
    else:
        file = compile_body_text(body, source="the body", root=root, own=True)
    rows = np.flatnonzero(np.isfinite(postures).all(axis=1))
    return PlacedBody(file, postures if len(rows) == len(postures) else postures[rows], rows)


# How near a body's observers came to each other and to a scene: on their own shapes, by the solver's own distances.

Measure = Callable[..., Any]
"""`_solver.shape_distances`, or the bound of these."""


@dataclass(frozen=True, eq=False)
class MovingShapes:
    """n shapes in T postures: kinds (n,) and sizes (n, 3) as in `scene_shapes`, position (T, n, 3) m and quat (T, n, 4)
    wxyz of their canonical frames."""

    kinds: IntArray
    sizes: FloatArray
    position: FloatArray
    quat: FloatArray

    def measured(self, measure: Measure, rows: IntArray, pairs: IntArray) -> Any:
        """What `measure` says of pairs (m, 2) in postures (m,)."""
        sides = [(self.kinds[of], self.sizes[of], self.position[rows, of], self.quat[rows, of]) for of in pairs.T]
        return measure(*sides[0], *sides[1])

    def look(self, closest: ClosestPairs, pairs: IntArray) -> None:
        """Look at the distances of pairs (P, 2) in all T postures."""

        def distances(rows: IntArray, which: IntArray) -> FloatArray:
            return np.asarray(self.measured(_solver.shape_distances, rows, pairs[which])[0])

        def bounds(rows: IntArray) -> FloatArray:
            every, which = (index.ravel() for index in np.meshgrid(rows, np.arange(len(pairs)), indexing="ij"))
            found = self.measured(_solver.shape_gaps_at_least, every, pairs[which])
            return np.asarray(found).reshape(len(rows), len(pairs))

        if len(pairs):
            closest.look(distances, bounds, len(self.position))


def observer_clearance(
    body: BodyModel, observers: Observers, q: FloatArray, *, scene: SceneState | None, times: FloatArray
) -> tuple[float | None, float | None, float | None]:
    """Smallest distance (m, negative inside) in postures q (T, nq) at `times` (T,): of pairs that are looked at, to any
    obstacle, and to the ground. None: nothing to look at."""
    if not len(q):
        return None, None, None
    own_pairs, scene_pairs, ground_pairs = observers.pairs, observers.pairs[:0], observers.pairs[:0]
    if scene is not None and scene.shapes.names:
        pairs, _ = observers.obstacle_pairs(scene.shapes)
        on_ground, pairs = scene.shapes.ground[pairs[:, 1]], pairs + np.array([0, len(observers.kinds)])
        scene_pairs, ground_pairs = pairs[~on_ground], pairs[on_ground]
    looks = [(pairs, ClosestPairs(())) for pairs in (own_pairs, scene_pairs, ground_pairs)]
    for rows in blocks(len(q)):
        shapes = _shapes(body, observers, q[rows], scene=scene, times=times[rows])
        for pairs, closest in looks:
            shapes.look(closest, pairs)
    own, obstacles, ground = (closest.found.smallest if len(pairs) else None for pairs, closest in looks)
    return own, obstacles, ground


def _shapes(
    body: BodyModel, observers: Observers, q: FloatArray, *, scene: SceneState | None, times: FloatArray
) -> MovingShapes:
    """The shapes of observers in postures q (T, nq), then those of the scene at `times` (T,)."""
    own = MovingShapes(observers.kinds, observers.sizes, *placed(body, observers, q))
    if scene is None or not scene.shapes.names:
        return own
    poses, shapes = [scene.at(max(float(time), 0.0)) for time in times], scene.shapes
    return MovingShapes(
        np.concatenate([own.kinds, shapes.kinds]),
        np.concatenate([own.sizes, shapes.sizes]),
        np.concatenate([own.position, np.stack([pose.position for pose in poses])], axis=1),
        np.concatenate([own.quat, np.stack([pose.quat for pose in poses])], axis=1),
    )


# How near the last stage's body came to itself and to its scene in a run: on its own geoms, and on its observers.

NEUTRAL = "attractor"
"""The human's posture in which pairs that touch are left out."""


NOTHING = Clearance(None, 0, None)
"""Nothing to compare."""


def robot_clearances(
    robot: RobotBody, q: FloatArray, scene: SceneState | None, times: FloatArray
) -> tuple[Clearance, Clearance, Clearance]:
    """The clearance of a robot in postures (T, nq), at times (T,) s on the clock of the scene: to itself, to the
    obstacles of the scene, and of links without a sole to its ground."""
    profile, placed = robot.profile, place_body(robot.profile.body_path, q, root=robot.profile.root)
    ignored, neutral = [entry.pair for entry in profile.ignore_pairs], robot.posture(profile.postures.neutral)
    to_itself = placed.to_itself(neutral=neutral, ignored=ignored)
    if scene is None:
        return to_itself, NOTHING, NOTHING
    feet = frozenset[str]().union(*(robot.foot_links if robot.on_floor else ()))
    return to_itself, placed.to_scene(scene, times), placed.to_ground(scene, times, feet=feet)


def clearances(run: RunResult) -> tuple[dict[str, Any], Clearances]:
    """The clearance of the postures that were sent to a robot, or else of the reconstructed human: on its own geoms, by
    the keys of the report, and of its observers. Of ticks that penetrate, one that does both counts twice."""
    robot, sent, times = run.robot, run.record.robot, np.maximum(run.record.time, 0.0)
    if robot is not None and sent is not None:
        body, q = robot.body, sent.q
        to_itself, to_scene, to_ground = robot_clearances(robot, q, run.scene, times)
    else:
        body, q = run.human.body, run.record.human_q
        placed = place_body(run.human.mjcf, q)
        to_itself, to_scene, to_ground = placed.to_itself(neutral=run.human.posture(NEUTRAL)), NOTHING, NOTHING
        if run.scene is not None:
            to_scene, to_ground = placed.to_scene(run.scene, times), placed.to_ground(run.scene, times, feet=())
    compared = [part for part in (to_itself, to_scene, to_ground) if part.smallest is not None]
    seen: tuple[float | None, float | None, float | None] = (None, None, None)
    if run.observers is not None:
        seen = observer_clearance(body, run.observers, q, scene=run.scene, times=run.record.time)
    deep = sum(part.deep for part in compared) if compared else None
    found = {
        "min_clearance_mm": Clearances(in_mm(to_itself.smallest), in_mm(to_scene.smallest), in_mm(to_ground.smallest)),
        "penetrating_frames": sum(part.penetrating for part in compared) if compared else None,
        "deep": DeepReport(deep, to_scene.pair, to_ground.pair),
        "closest_links": to_itself.pair,
    }
    return found, Clearances(*(in_mm(distance) for distance in seen))


def in_mm(metres: float | None) -> float | None:
    """Metres in mm; None stays not known."""
    return None if metres is None else MM * metres
