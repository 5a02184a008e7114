"""What the page's player draws: performer, robot, centre of mass and soles, in fewer rows than there are ticks."""

import json
import math
from dataclasses import asdict, dataclass

import numpy as np

from retarget.body import IntArray
from retarget.frames import BoolArray
from retarget.human_dimensions import PARENTS, POINTS
from retarget.metrics import standing
from retarget.plots.poses import ROBOT_BONES, performer_facing
from retarget.plots.skeleton import turned
from retarget.record import Phase
from retarget.report_page.moments import moments
from retarget.report_page.obstacles import wires_of
from retarget.report_page.packing import Packed, packed
from retarget.rotations import FloatArray
from retarget.run_result import RunResult

__all__ = ["Animation", "Figure", "animation_of"]

FPS = 30.0
MOST_ROWS = 3000
"""More pictures a second are not seen; a long run is shown more coarsely."""
TRAVEL = 0.5
"""A body that gets farther than this share of its height is followed by the view."""
PARENT = {name: POINTS[parent] for name, parent in zip(POINTS, PARENTS, strict=True) if parent >= 0}


@dataclass(frozen=True)
class Figure:
    """A body. points (T, k, 3) of names; bones: pairs of points. marks (T, m, 3): what was measured of a performer, or
    asked of a robot. centre (T, 2): where the view looks. height, reach m: what it must show."""

    label: str
    names: tuple[str, ...]
    bones: tuple[tuple[int, int], ...]
    points: Packed
    marks: Packed
    mark_count: int
    centre: Packed
    height: float
    reach: float


@dataclass(frozen=True)
class Ground:
    """corners (T, c, 3) of all soles, `sizes` of them each; com (T, 3). contact: m above the ground that still carry.
    outside: a letter a row, 1 where the centre of mass was beyond the edge in any of its ticks."""

    corners: Packed
    sizes: tuple[int, ...]
    com: Packed
    contact: float
    outside: str


@dataclass(frozen=True)
class Obstacles:
    """points (rows, p, 3): a row for each of the animation's, or one where nothing moves; edges: pairs of points."""

    points: Packed
    rows: int
    edges: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Animation:
    """time: ms. phase, gated: a letter a row. every: ticks to a row. moments: ms, at which something went wrong."""

    time: tuple[int, ...]
    phase: str
    gated: str
    every: int
    performer: Figure
    robot: Figure | None
    ground: Ground | None
    obstacles: Obstacles | None
    moments: tuple[int, ...]
    simulated: bool

    def as_json(self) -> str:
        """Compact, and safe inside a script element: no character there can end it."""
        text = json.dumps(asdict(self), separators=(",", ":"), allow_nan=False)
        return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def animation_of(run: RunResult) -> Animation | None:
    """None of a run that followed nothing."""
    record, following = run.record, run.record.following
    if following.stop - following.start < 2:
        return None
    every = max(1, math.ceil(1.0 / (run.clip.dt * FPS) - 1e-9), math.ceil(len(record) / MOST_ROWS))
    rows = np.arange(0, len(record), every)
    sent = record.robot
    return Animation(
        time=tuple(round(1e3 * time) for time in record.time[rows]),
        phase="".join(Phase(value).name[0].lower() for value in record.phase[rows]),
        gated="0" * len(rows) if sent is None else _letters(sent.gated, rows),
        every=every,
        performer=_performer(run, rows),
        robot=_robot(run, rows),
        ground=_ground(run, rows),
        obstacles=_obstacles(run, rows),
        moments=tuple(round(1e3 * moment.time) for moment in moments(run)),
        simulated=run.physics is not None,
    )


def _performer(run: RunResult, rows: IntArray) -> Figure:
    """The reconstructed human and the sensors, turned so that it faces x where following begins."""
    human = run.record.human
    facing = np.repeat(performer_facing(run)[:1], len(rows), axis=0)
    names = human.joint_names
    bones = tuple((names.index(PARENT[name]), at) for at, name in enumerate(names) if PARENT.get(name) in names)
    return _figure(
        "performer", names, bones, turned(human.joints[rows], facing), turned(run.sensors_asked[rows], facing)
    )


def _robot(run: RunResult, rows: IntArray) -> Figure | None:
    """The robot as it was sent, and the landmarks that were asked of it; by its frames, or else by its links."""
    robot, sent = run.robot, run.record.robot
    if robot is None or sent is None:
        return None
    q = np.ascontiguousarray(sent.q[rows])
    names = tuple(robot.profile.frames)
    bones = tuple((names.index(a), names.index(b)) for a, b in ROBOT_BONES if a in names and b in names)
    points = robot.points(q, names)
    if len(bones) < len(names) / 2:
        links = list(range(1, len(robot.body.body_names)))
        names = robot.body.body_names[1:]
        bones = tuple((int(parent) - 1, at) for at, parent in enumerate(robot.body.parent[1:]) if parent > 0)
        points = robot.body.solver_body().points(q, links, np.zeros((len(links), 3)))
    return _figure(robot.profile.name, names, bones, points, sent.landmarks_asked[rows])


def _figure(
    label: str, names: tuple[str, ...], bones: tuple[tuple[int, int], ...], points: FloatArray, marks: FloatArray
) -> Figure:
    height = max(float(np.nanmax(points[..., 2])), 1e-3)
    centre = np.nanmean(points[..., :2], axis=1)
    if np.ptp(centre, axis=0).max() < TRAVEL * height:
        centre = np.repeat(np.median(centre, axis=0)[None], len(centre), axis=0)
    else:
        centre = _smooth(centre, int(FPS))
    reach = float(np.nanmax(np.linalg.norm(points[..., :2] - centre[:, None], axis=-1)))
    return Figure(label, names, bones, packed(points), packed(marks), marks.shape[1], packed(centre), height, reach)


def _smooth(track: FloatArray, width: int) -> FloatArray:
    """Moving mean over `width` rows of a track (T, 2), which goes on as it ends."""
    half = width // 2
    padded = np.vstack([np.repeat(track[:1], half, axis=0), track, np.repeat(track[-1:], width - 1 - half, axis=0)])
    kernel = np.full(width, 1.0 / width)
    return np.column_stack([np.convolve(column, kernel, mode="valid") for column in padded.T])


def _ground(run: RunResult, rows: IntArray) -> Ground | None:
    """Soles and centre of mass of a robot that stands."""
    robot, sent = run.robot, run.record.robot
    if robot is None or sent is None or not robot.stands:
        return None
    corners = [standing.sole_corners(sole) for sole in standing.soles_of(robot, sent.q)]
    com = robot.body.solver_body().centre_of_mass(np.ascontiguousarray(sent.q))
    every = np.concatenate(corners, axis=1)
    outside = ~(standing.support_margin(com, every) >= -standing.OUTSIDE_M)
    sizes = tuple(sole.shape[1] for sole in corners)
    return Ground(packed(every[rows]), sizes, packed(com[rows]), standing.CONTACT_M, _letters(outside, rows))


def _obstacles(run: RunResult, rows: IntArray) -> Obstacles | None:
    """What is around the last stage's body, in the world that its figure is drawn in."""
    wires = None if run.scene is None else wires_of(run.scene, np.maximum(run.record.time[rows], 0.0))
    if wires is None:
        return None
    points = wires.points
    if run.robot is None:
        points = turned(points, np.repeat(performer_facing(run)[:1], len(points), axis=0))
    return Obstacles(packed(points), len(points), wires.edges)


def _letters(flags: BoolArray, rows: IntArray) -> str:
    """1 for a row in any tick of which the flag (T,) is up, else 0."""
    return "".join("1" if value else "0" for value in np.maximum.reduceat(flags, rows))
