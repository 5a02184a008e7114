"""Collision observers of a robot and of the virtual human: shapes on links, and the pairs of them that are checked."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from retarget import _solver, rotations
from retarget.arithmetic import norm
from retarget.errors import ConfigError, Problem
from retarget.model.body import BodyModel, Geom
from retarget.model.human import Human
from retarget.model.robot import RobotBody
from retarget.model.scene_shapes import SceneShapes, ShapeKind, canonical
from retarget.model.scene_state import SceneState
from retarget.rotations import arc, as_vector
from retarget.schema.priorities import ObserverSettings
from retarget.schema.profile_parts import Observer
from retarget.types import FloatArray, IntArray

# Pairs of observers that are checked (paper, "Handling self collisions").

NEAR_LINKS = 2
"""Joints between links that may touch at rest, and are not checked then."""

AT_HOME = 0.75
"""Greatest margin of a pair, relative to its distance at rest."""


@dataclass(frozen=True)
class DroppedPair:
    """Names of two observers that are not checked against each other. neighbours: on links with one joint between."""

    first: str
    second: str
    reason: str
    neighbours: bool = False


@dataclass(frozen=True, eq=False)
class PairRules:
    """Rules for pairs. neutral: posture (nq,) in which touching pairs are dropped. resting: others that bound margins.
    ignored: links, and reasons. where: for messages. given: a human, all of whose touching pairs are dropped."""

    neutral: FloatArray
    resting: tuple[FloatArray, ...] = ()
    ignored: tuple[tuple[int, int, str], ...] = field(default=())
    where: str = ""
    given: bool = False


def checked_pairs(
    body: BodyModel, observers: "Observers", rules: PairRules
) -> tuple[IntArray, tuple[DroppedPair, ...], FloatArray]:
    """Checked pairs (p, 2), dropped pairs, and greatest margins (p,) m. Raises ConfigError for parts that are
    far apart along the body and touch in the neutral posture."""
    ignored = {frozenset(pair[:2]): pair[2] for pair in rules.ignored}
    checked, dropped = [], []
    for first, second in zip(*np.triu_indices(len(observers.names), 1), strict=True):
        links = int(observers.links[first]), int(observers.links[second])
        steps = steps_between(body, *links)
        if steps == 0:
            continue
        reason = "neighbours along the body" if steps == 1 else ignored.get(frozenset(links))
        if reason is None:
            checked.append((first, second))
        else:
            dropped.append(DroppedPair(observers.names[first], observers.names[second], reason, steps == 1))
    pairs = np.array(checked, dtype=np.int64).reshape(-1, 2)
    distance = _distances(body, observers, pairs, rules.neutral)
    touching = distance <= 0.0
    problems = []
    for (first, second), depth in zip(pairs[touching], -distance[touching], strict=True):
        names = observers.names[first], observers.names[second]
        steps = steps_between(body, int(observers.links[first]), int(observers.links[second]))
        if steps > NEAR_LINKS and not rules.given:
            what = "parts that are far apart along the body touch in the neutral posture"
            found = f"{names[0]} and {names[1]}, {steps} joints apart, {1e3 * depth:.1f} mm deep"
            allowed = f"a touch of parts at most {NEAR_LINKS} joints apart"
            step = "Move the neutral posture, draw the shapes tighter, or ignore the pair with a reason"
            problems.append(Problem(what, rules.where, found, allowed, step))
        dropped.append(DroppedPair(*names, f"touch by {1e3 * depth:.1f} mm in the neutral posture"))
    if problems:
        raise ConfigError.from_problems(problems)
    pairs = np.ascontiguousarray(pairs[~touching])
    resting = [_distances(body, observers, pairs, q) for q in (rules.neutral, *rules.resting)]
    margin = AT_HOME * np.maximum(np.min(resting, axis=0), 0.0)
    return pairs, tuple(dropped), margin


def placed(body: BodyModel, observers: "Observers", q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """World positions (..., n, 3) and orientations (..., n, 4) wxyz of observers' frames in postures (...,
    nq)."""
    solver, links, rows = body.solver_body(), observers.links.tolist(), np.ascontiguousarray(np.atleast_2d(q))
    position = solver.points(rows, links, np.ascontiguousarray(observers.positions))
    quat = rotations.multiply(solver.orientations(rows, links), observers.quats)
    return (position, quat) if q.ndim > 1 else (position[0], quat[0])


def _distances(body: BodyModel, observers: "Observers", pairs: IntArray, q: FloatArray) -> FloatArray:
    position, quat = placed(body, observers, q)
    kinds, sizes = observers.kinds, observers.sizes
    a, b = (np.ascontiguousarray(column) for column in pairs.T)
    return _solver.shape_distances(kinds[a], sizes[a], position[a], quat[a], kinds[b], sizes[b], position[b], quat[b])[
        0
    ]


def steps_between(body: BodyModel, first: int, second: int) -> int:
    """Number of links with joints between two links."""
    return len(body.links_between(first, second).intersection(body.joint_body.tolist()))


NO_SCENE = SceneShapes(  # no obstacle
    (), np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0, dtype=bool)
)

ShapeRow = tuple[ShapeKind, tuple[float, float, float], FloatArray, FloatArray]
"""Kind, sizes (3,) m, position (3,) m and quat (4,) wxyz of a shape's canonical frame on its link."""


class Part(NamedTuple):
    """An observer: number of its link, shape (see `ShapeRow`), influence and margin, m."""

    link: int
    kind: ShapeKind
    sizes: tuple[float, float, float]
    position: FloatArray
    quat: FloatArray
    influence: float
    margin: float


@dataclass(frozen=True, eq=False)
class Observers:
    """n observers of a body and p checked pairs.

    links (n,); kinds (n,), sizes (n, 3): see `scene_shapes`; positions (n, 3) m, quats (n, 4) wxyz: on the links;
    influence, margin (n,) m. pairs (p, 2): rows; pair_margin (p,) m: greatest margins. stands (n,): on a link with a
    sole, not checked against the ground; ground_margin (n,) m: greatest margins.
    """

    names: tuple[str, ...]
    links: IntArray
    kinds: IntArray
    sizes: FloatArray
    positions: FloatArray
    quats: FloatArray
    influence: FloatArray
    margin: FloatArray
    pairs: IntArray
    dropped: tuple[DroppedPair, ...]
    pair_margin: FloatArray
    stands: NDArray[np.bool_]
    ground_margin: FloatArray

    def with_margin(self, margin: float | None) -> "Observers":
        """Observers with another margin, m; None: their own."""
        return self if margin is None else replace(self, margin=np.full_like(self.margin, margin))

    def obstacle_pairs(self, scene: SceneShapes) -> tuple[IntArray, FloatArray]:
        """Checked pairs (m, 2) of observers and obstacles, obstacle by obstacle, without soles and ground; and
        greatest margins (m,) m."""
        which, obstacle = (part.ravel() for part in np.indices((len(self.names), len(scene.names))).swapaxes(1, 2))
        looks = ~(self.stands[which] & scene.ground[obstacle])
        most = np.where(scene.ground[obstacle], self.ground_margin[which], np.inf)
        return np.ascontiguousarray(np.column_stack([which, obstacle])[looks]), np.ascontiguousarray(most[looks])

    def for_solver(
        self, body: BodyModel, scene: SceneShapes = NO_SCENE, *, looks: NDArray[np.bool_] | None = None
    ) -> _solver.Observers:
        """Observers for the compiled solver, with k obstacles of a scene. looks (n, k): mask of checked
        pairs; None: `obstacle_pairs`."""
        obstacle_pairs, most = self.obstacle_pairs(scene)
        if looks is not None:
            obstacle_pairs = np.ascontiguousarray(np.argwhere(looks))
            most = np.full(len(obstacle_pairs), np.inf)
        return _solver.Observers(
            body.solver_body(),
            links=self.links,
            kinds=self.kinds,
            sizes=self.sizes,
            positions=self.positions,
            quats=self.quats,
            influence=self.influence,
            margin=self.margin,
            pairs=self.pairs,
            pair_margin=self.pair_margin,
            obstacle_kinds=scene.kinds,
            obstacle_sizes=scene.sizes,
            obstacle_influence=scene.influence,
            obstacle_margin=scene.margin,
            obstacle_pairs=obstacle_pairs,
            obstacle_pair_margin=most,
        )


def robot_observers(robot: RobotBody) -> Observers:
    """Observers of a robot's profile. Raises ConfigError; see `checked_pairs`."""
    profile, body = robot.profile, robot.body
    parts = {
        name: Part(body.body_index(entry.link), *_shape(body, entry), entry.influence, entry.margin)
        for name, entry in profile.observers.items()
    }
    ignored = [
        (body.body_index(entry.pair[0]), body.body_index(entry.pair[1]), entry.reason) for entry in profile.ignore_pairs
    ]
    rules = PairRules(
        neutral=robot.posture(profile.postures.neutral),
        resting=(robot.posture(profile.postures.stand),),
        ignored=tuple(ignored),
        where=str(profile.path),
    )
    observers = assemble(body, parts, rules)
    return _on_ground(robot, observers) if robot.on_floor else observers


def _on_ground(robot: RobotBody, observers: Observers) -> Observers:
    """Observers of a robot on its feet, whose soles are not checked against the ground. Raises ConfigError for a part
    below the soles in the neutral posture."""
    postures = robot.profile.postures
    feet = frozenset[str]().union(*robot.foot_links)
    stands = np.array([robot.body.body_names[link] in feet for link in observers.links.tolist()], dtype=bool)
    neutral, *others = (
        _heights(robot, observers, angles) for angles in (postures.neutral, postures.stand, postures.rest)
    )
    below = sorted(np.flatnonzero(~stands & (neutral <= 0.0)).tolist(), key=lambda k: neutral[k])
    if below:
        others_below = f" (and {len(below) - 1} more)" if below[1:] else ""
        raise ConfigError(
            "a part is below the soles in the neutral posture",
            where=str(robot.profile.path),
            found=f"{observers.names[below[0]]}, {-1e3 * neutral[below[0]]:.1f} mm below the ground{others_below}",
            allowed="only links with a sole touch the ground, and what fixed joints hold to them",
            next_step="Move the neutral posture, draw its shape tighter, or describe its sole in `feet`",
        )
    return replace(
        observers, stands=stands, ground_margin=AT_HOME * np.maximum(np.min([neutral, *others], axis=0), 0.0)
    )


def _heights(robot: RobotBody, observers: Observers, angles: dict[str, float]) -> FloatArray:
    """Lowest heights (n,) m of observers above the plane of the first sole, with these joint angles, rad."""
    q, sole = robot.posture(angles), (next(iter(robot.profile.feet.values())).frame,)
    position, quat = placed(robot.body, observers, q)
    n = len(observers.names)
    ground = (
        np.full(n, int(ShapeKind.HALF_SPACE)),
        np.zeros((n, 3)),
        np.tile(robot.points(q[None], sole)[0], (n, 1)),
        np.tile(robot.orientations(q[None], sole)[0], (n, 1)),
    )
    return _solver.shape_distances(observers.kinds, observers.sizes, position, quat, *ground)[0]


def assemble(body: BodyModel, parts: Mapping[str, Part], rules: PairRules) -> Observers:
    """Observers by name, with their checked pairs."""
    rows = tuple(parts.values())
    none = Observers(
        names=tuple(parts),
        links=np.array([part.link for part in rows], dtype=np.int64),
        kinds=np.array([part.kind for part in rows], dtype=np.int64),
        sizes=np.array([part.sizes for part in rows], dtype=float).reshape(-1, 3),
        positions=np.array([part.position for part in rows], dtype=float).reshape(-1, 3),
        quats=np.array([part.quat for part in rows], dtype=float).reshape(-1, 4),
        influence=np.array([part.influence for part in rows], dtype=float),
        margin=np.array([part.margin for part in rows], dtype=float),
        pairs=np.zeros((0, 2), dtype=np.int64),
        dropped=(),
        pair_margin=np.zeros(0),
        stands=np.zeros(len(rows), dtype=bool),
        ground_margin=np.full(len(rows), np.inf),
    )
    pairs, dropped, margin = checked_pairs(body, none, rules)
    return replace(none, pairs=pairs, dropped=dropped, pair_margin=margin)


def geom_shape(geom: Geom) -> ShapeRow | None:
    """Shape of a geom; None for kinds without observers (meshes, ellipsoids)."""
    size = tuple(float(value) for value in geom.size)
    first, second, third = size
    known = {
        "capsule": (ShapeKind.CAPSULE, (first, second, 0.0)),
        "sphere": (ShapeKind.CAPSULE, (first, 0.0, 0.0)),
        "cylinder": (ShapeKind.CYLINDER, (first, second, 0.0)),
        "box": (ShapeKind.BOX, (first, second, third)),
    }.get(geom.kind)
    return None if known is None else (*known, geom.position, geom.quat)


def _shape(body: BodyModel, observer: Observer) -> ShapeRow:
    if observer.shape.geom is None:
        kind, sizes, pose = canonical(observer.shape)
        return kind, sizes, np.array(pose.position), np.array(pose.quat)
    geom = next(geom for geom in body.geoms if geom.name == observer.shape.geom)
    row = geom_shape(geom)
    if row is None:
        raise ConfigError(
            "a geom that no observer can take over",
            where=body.source,
            found=f"{geom.name}, a {geom.kind}",
            allowed="capsule, sphere, cylinder, box",
            next_step="Give the observer a shape of its own (retarget fit-observers proposes one)",
        )
    return row


# Observers of the virtual human: lines of the paper, or capsules of all segments.

NEUTRAL = "attractor"
"""Posture in which pairs that touch are dropped, with arms away from the trunk."""
LIMB_LINES = (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))
"""Ends of the paper's lines on the limbs of each side, by joint."""
HEAD = "head"

ObserverSet = Literal["none", "lines", "lines_and_head", "capsules"]


def human_observers(human: Human, settings: ObserverSettings) -> Observers | None:
    """Observers of a human; None without any."""
    chosen = settings.human
    if chosen == "none":
        return None
    zone = settings.influence, 0.01 if settings.margin is None else settings.margin
    parts = {}
    if chosen != "capsules":
        for near, far in LIMB_LINES:
            for side in "lr":
                link, end = human.body.body_index(f"{side}_{near}"), human.dimensions.of(f"{side}_{far}")
                turn = np.array(arc((0.0, 0.0, 1.0), as_vector(end)))
                line = ShapeKind.CAPSULE, (0.0, 0.5 * norm(end), 0.0), 0.5 * end, turn
                parts[f"{side}_{near}"] = Part(link, *line, *zone)
    if chosen != "lines":
        for geom in human.body.geoms:
            if chosen == "capsules" or geom.name == HEAD:
                row = geom_shape(geom)
                assert row is not None, "a human is made of capsules and balls"
                parts[geom.name] = Part(geom.body, *row, *zone)
    rules = PairRules(neutral=human.posture(NEUTRAL), given=True)
    return assemble(human.body, parts, rules)


CONTACT_M = 1e-4
"""Least depth of a contact, m, as in the solver; less is rounding."""


@dataclass(frozen=True)
class Contact:
    """An observer, the observer or obstacle that it touches, and the depth, m."""

    part: str
    other: str
    depth: float


def contacts(
    body: BodyModel,
    observers: Observers,
    scene: SceneState | None,
    q: FloatArray,
    *,
    time: float = 0.0,
    deeper_than: float = CONTACT_M,
) -> tuple[Contact, ...]:
    """Contacts in posture q (nq,) at a time of the scene, s, the deepest first."""
    position, quat = placed(body, observers, q)
    n, pairs = len(observers.names), observers.pairs
    kinds, sizes, others = observers.kinds, observers.sizes, observers.names
    if scene is not None:
        poses, shapes = scene.at_rest(time), scene.shapes
        kinds, sizes = np.concatenate([kinds, shapes.kinds]), np.concatenate([sizes, shapes.sizes])
        position, quat = np.concatenate([position, poses.position]), np.concatenate([quat, poses.quat])
        with_scene, _ = observers.obstacle_pairs(shapes)
        pairs, others = np.concatenate([pairs, with_scene + np.array([0, n])]), others + shapes.names
    a, b = pairs[:, 0], pairs[:, 1]
    depths = -_solver.shape_distances(
        kinds[a], sizes[a], position[a], quat[a], kinds[b], sizes[b], position[b], quat[b]
    )[0]
    order = np.argsort(-depths, kind="stable")
    touching = [row for row in order.tolist() if depths[row] > deeper_than]
    return tuple(Contact(others[pairs[row, 0]], others[pairs[row, 1]], float(depths[row])) for row in touching)
