"""How well a run followed: errors, lag, reach of the hands, and the error of the highest level."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from retarget import _solver, rotations
from retarget.ik.support_polygon import Stance, plant
from retarget.model.human import PostureReader
from retarget.model.human_dimensions import POINTS, HumanDimensions
from retarget.model.robot import TRUNK, RobotBody
from retarget.report import motion_metrics
from retarget.report.motion_metrics import blocks, in_blocks
from retarget.robot.arm_branches import arm_postures, chain_to_anchor, position_limits
from retarget.robot.landmarks import PELVIS, Facing, limb_scale
from retarget.run.run_result import RunResult
from retarget.schema.priorities import AxisTask, CentreOfMassTask, OrientationTask, PositionTask, Priorities, Task
from retarget.schema.profile_parts import Landmark
from retarget.types import ORIENTED, BoolArray, FloatArray

STILL_M = 1e-3
"""Least way, m, that is asked of a landmark whose path is judged: less says nothing about moving."""
ENDS = (2.0, 98.0)
"""Percentiles between which a range lies: one bad frame in fifty is no range."""
LONGEST_LAG_S = 1.0
COARSE = 4
"""Lags are looked at in steps of so many ticks first: no body moves so fast that a peak is narrower."""


def distances(asked: FloatArray, reached: FloatArray) -> FloatArray:
    """Distance (T, k) m between tracks (T, k, 3)."""
    return np.asarray(np.linalg.norm(reached - asked, axis=-1))


def path_ratio(asked: FloatArray, reached: FloatArray) -> float | None:
    """Length of the paths reached over that of the paths asked, tracks (T, k, 3); None where nothing was asked to move.

    A robot that stands still shows 0.
    """
    known = _known(asked, reached)
    if np.count_nonzero(known) < 2:
        return None
    wanted = _path_length(asked[known])
    return None if wanted < STILL_M else _path_length(reached[known]) / wanted


def _known(*tracks: FloatArray) -> BoolArray:
    """Whether (T,) all tracks (T, k, 3) are known."""

    def known(rows: slice) -> BoolArray:
        return np.asarray(np.all([np.isfinite(track[rows]).all(axis=(1, 2)) for track in tracks], axis=0))

    return in_blocks(known, len(tracks[0]))


def excursion_ratio(asked: FloatArray, reached: FloatArray) -> float | None:
    """Range of the heights reached over that of the heights asked, (T,) m; None where nothing was asked to move."""
    known = np.isfinite(asked) & np.isfinite(reached)
    wanted = extent(asked[known])
    return None if wanted < STILL_M else extent(reached[known]) / wanted


def extent(values: FloatArray) -> float:
    """Length of the diagonal of the ranges of values (T,) or (T, k) that are known, between `ENDS`; 0 without any."""
    rows = values if values.ndim == 2 else values[:, None]
    known = rows[np.isfinite(rows).all(axis=1)]
    low, high = np.percentile(known, ENDS, axis=0) if len(known) else np.zeros((2, 1))
    return float(np.linalg.norm(high - low))


FOOT_S = 0.1
"""A foot is looked at so often, s: a swing lasts several times as long."""
FOOT_M = 0.003
"""A foot that got no farther than this in that time, m in the size of the robot, stands and trembles."""


def foot_path_ratio(asked: FloatArray, reached: FloatArray, dt: float) -> float | None:
    """Length of the paths of feet reached over those asked, tracks (T, k, 3) m in the size of the robot, `dt` s apart;
    None where the feet stood. A robot that stays planted while its performer walks shows 0."""
    every = max(round(FOOT_S / dt), 1)
    known = np.isfinite(asked).all(axis=(1, 2)) & np.isfinite(reached).all(axis=(1, 2))
    paths = []
    for track in (asked, reached):
        steps = np.linalg.norm(np.diff(track[known][::every], axis=0), axis=-1)
        paths.append(float(steps[steps > FOOT_M].sum()))
    return paths[1] / paths[0] if paths[0] > 0.0 else None


def lag(asked: FloatArray, reached: FloatArray, dt: float) -> float | None:
    """Time (s) by which tracks reached (T, k, 3) m trail those asked, where their cross-correlation is highest.

    All coordinates together, each about its mean over the ticks compared; lags from 0 to LONGEST_LAG_S, between ticks
    by a parabola. None where either stands still, or the correlation still rises at the last lag: the run is too short.
    """
    known = np.flatnonzero(_known(asked, reached))
    whole = known.size > 0 and known[-1] - known[0] + 1 == known.size  # then a view of the track, which may be long
    rows = slice(known[0], known[-1] + 1) if whole else known
    a, b = (track[rows].reshape(-1, 3 * track.shape[1]) for track in (asked, reached))
    steps = min(round(LONGEST_LAG_S / dt), len(a) // 2)
    if steps < 2 or _spread(a) < STILL_M or _spread(b) < STILL_M:
        return None
    coarse = range(0, steps + 1, COARSE)
    near = max(coarse, key=lambda step: _correlation(a, b, step))
    first, last = max(near - COARSE, 0), min(near + COARSE, steps)
    score = np.array([_correlation(a, b, step) for step in range(first, last + 1)])
    best = int(np.argmax(score))
    if first + best == steps:
        return None
    return float((first + best + _vertex(score, best)) * dt)


def _path_length(track: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(track, axis=0), axis=-1).sum())


def _spread(track: FloatArray) -> float:
    """Root mean square of the distance of (T, c) from its mean, m."""
    return float(np.sqrt(_inner(track, track)[0] / len(track)))


def _correlation(asked: FloatArray, reached: FloatArray, step: int) -> float:
    """Normalised correlation of what was asked with what was reached `step` ticks later."""
    both, a, b = _inner(asked[: len(asked) - step], reached[step:])
    size = float(np.sqrt(a * b))
    return both / size if size > 0.0 else 0.0


def _inner(a: FloatArray, b: FloatArray) -> tuple[float, float, float]:
    """Sums of products of (T, c) and (T, c) about their means: of both, of the first and of the second with itself. Not
    by BLAS, whose threads wait for each other on a busy machine."""
    means, sums = (a.mean(axis=0), b.mean(axis=0)), np.zeros(3)
    for rows in blocks(len(a)):
        x, y = a[rows] - means[0], b[rows] - means[1]
        sums += [np.einsum("ij,ij->", *pair) for pair in ((x, y), (x, x), (y, y))]
    both, first, second = sums.tolist()
    return both, first, second


def _vertex(score: FloatArray, best: int) -> float:
    """Where the parabola through three neighbours peaks, in ticks from `best`; 0 at the ends."""
    if best in (0, len(score) - 1):
        return 0.0
    before, here, after = score[best - 1 : best + 2]
    bend = before - 2.0 * here + after
    return 0.0 if bend >= 0.0 else float(0.5 * (before - after) / bend)


# Whether anything was taken from the highest level: errors of its tasks, measured on the postures that were sent.


def top_tasks(priorities: Priorities) -> tuple[Task, ...]:
    """The tasks of the first level that asks for anything; observers, which only react, do not count."""
    for level in priorities.levels:
        tasks = tuple(task for task in level.tasks if task.type not in ("reactive", "preventive", "posture"))
        if tasks:
            return tasks
    return ()


def top_level_error(run: RunResult) -> float | None:
    """Largest error, m or rad, of any task of the highest level of the last stage, over the run.

    Measured: positions that are landmarks or sensors, the centre of mass, soles that are to be flat, axes. None where
    the level holds nothing of the kind.
    """
    if not run.setup.priorities:
        return None
    errors = [error for task in top_tasks(run.setup.priorities[-1]) for error in _errors(task, run)]
    known = [float(np.nanmax(error)) for error in errors if np.isfinite(error).any()]
    return max(known) if known else None


def _errors(task: Task, run: RunResult) -> Iterable[FloatArray]:
    """Error (T,) of each part of a task that can be measured from outside."""
    robot, sent = run.robot, run.record.robot
    if isinstance(task, CentreOfMassTask):
        if robot is None or sent is None:
            yield run.record.balance_error
        elif task.mode == "support" and robot.stands:
            yield np.maximum(task.margin - motion_metrics.standing_of(robot, sent.q).margin, 0.0)
    elif isinstance(task, PositionTask):
        names, asked, reached = run.followed
        counts = np.array([float(weight > 0.0) for weight in task.weight])  # 1 for the rows that it asks for
        errors = in_blocks(lambda rows: distances(asked[rows] * counts, reached[rows] * counts), len(asked))
        yield from (_locked(run, name, errors[:, names.index(name)]) for name in task.of if name in names)
    elif robot is not None and sent is not None:
        if isinstance(task, OrientationTask):
            flat = {foot.frame for foot in robot.profile.feet.values()}
            for name in task.of:
                if name in flat:
                    yield _locked(run, name, motion_metrics.tilt(robot.orientations(sent.q, (name,))[:, 0]))
        elif isinstance(task, AxisTask):
            axis = np.array(task.axis) / np.linalg.norm(task.axis)
            direction = np.array(task.direction) / np.linalg.norm(task.direction)
            for name in task.of:
                if name in robot.profile.frames:
                    pointed = rotations.rotate(robot.orientations(sent.q, (name,))[:, 0], axis)
                    yield np.arccos(np.clip(pointed @ direction, -1.0, 1.0))


def _locked(run: RunResult, name: str, error: FloatArray) -> FloatArray:
    """The error (T,) of a sole while it is to stay: that of a robot that walks is no task of this level. All of
    others."""
    robot = run.robot
    walks = run.tally.walk is not None and run.tally.walk.steps > 0
    if not walks or robot is None or name not in {foot.frame for foot in robot.profile.feet.values()}:
        return error
    return np.full_like(error, np.nan)


# Where the hands are asked, seen from the torso that is asked: from the performer and constants of the robot alone.
#
# What the robot does takes no part, so a robot that stands still hides nothing. An asked hand is the asked shoulder and
# the performer's arm, scaled, in the performer's heading (`landmarks`); so the asked shoulders are the asked hands less
# those arms, and shoulders and pelvis show how the asked torso is turned.

HANDS = ("l_hand", "r_hand")


@dataclass(frozen=True, eq=False)
class ReferenceMotion:
    """What was asked, and of whom. joints (T, m, 3) m and pelvis (T, 4) wxyz: of the human, in the human's world.

    landmarks (T, k, 3) m: asked of the robot. dt: s between ticks, of the robot's clock. goes_along: the robot goes and
    turns where they do, so that it sees them in the heading in which they began.
    """

    dimensions: HumanDimensions
    joint_names: tuple[str, ...]
    joints: FloatArray
    pelvis: FloatArray
    landmark_names: tuple[str, ...]
    landmarks: FloatArray
    dt: float
    goes_along: bool = False

    @cached_property
    def heading(self) -> FloatArray:
        """Unit vectors (T, 2) on the ground where the performer faces, as the robot takes them."""
        found = headings(self.pelvis, self.joint_names, self.joints, self.dt)
        return _held(found) if self.goes_along else found

    def of(self, rows: slice) -> "ReferenceMotion":
        """Some of the ticks, with the headings that they have among all."""
        part = replace(self, joints=self.joints[rows], pelvis=self.pelvis[rows], landmarks=self.landmarks[rows])
        part.__dict__["heading"] = self.heading[rows]  # where `cached_property` keeps it: a heading follows all ticks
        return part

    @property
    def standing(self) -> dict[str, FloatArray]:
        """Place (3,) m of each joint of the performer who stands upright."""
        return dict(zip(POINTS, self.dimensions.standing(), strict=True))

    def mean(self, names: Sequence[str]) -> FloatArray:
        """Mean place (T, 3) m of some joints."""
        return np.asarray(self.joints[:, [self.joint_names.index(name) for name in names]].mean(axis=1))


def performance_of(run: RunResult) -> ReferenceMotion | None:
    """What was asked of the robot of a run, and of whom; None where nothing was."""
    record, sent = run.record, run.record.robot
    if sent is None or not len(sent.q):
        return None
    return ReferenceMotion(
        dimensions=run.human.dimensions,
        joint_names=record.human_joint_names,
        joints=record.human_joints,
        pelvis=_pelvis_turns(run, record.human_q),
        landmark_names=sent.landmark_names,
        landmarks=run.seen(sent.landmarks_asked),
        dt=run.clip.dt,
        goes_along=_goes_along(run),
    )


def asked_arms(robot: RobotBody, stance: Stance, asked: ReferenceMotion) -> dict[str, FloatArray]:
    """Hand -> place (T, 3) m where it is asked, as the torso carries it while the robot stands in its stance.

    Empty without landmarks for both hands.
    """
    turn = asked_torso(robot, stance, asked)
    if turn is None:
        return {}
    arms = asked_limbs({name: robot.profile.landmarks[name] for name in HANDS}, asked)
    return {name: _stood(robot, stance, name) + as_carried(turn, arm) for name, arm in arms.items()}


def asked_torso(robot: RobotBody, stance: Stance, asked: ReferenceMotion) -> FloatArray | None:
    """How the torso that is asked is turned from that of the stance (T, 3, 3), in the performer's heading; None without
    landmarks for both hands."""
    if not set(HANDS) <= set(asked.landmark_names):
        return None
    if "pelvis" not in asked.landmark_names:
        return np.tile(np.eye(3), (len(asked.landmarks), 1, 1))
    place = {name: asked.landmarks[:, asked.landmark_names.index(name)] for name in (*HANDS, "pelvis")}
    arms = asked_limbs({name: robot.profile.landmarks[name] for name in HANDS}, asked)
    stood = {name: _stood(robot, stance, name) for name in HANDS}
    hips = stance.points[robot.profile.landmarks["pelvis"].frame]
    shoulders = {name: place[name] - arm for name, arm in arms.items()}
    return np.asarray(_torso(shoulders, place["pelvis"]) @ _torso(stood, hips).T)


def as_carried(turn: FloatArray, lines: FloatArray) -> FloatArray:
    """Lines (T, ..., 3) as a torso sees them that is turned (T, 3, 3) from its stance."""
    return np.asarray(np.einsum("tji,t...j->t...i", turn, lines))


def asked_limbs(entries: Mapping[str, Landmark], asked: ReferenceMotion) -> dict[str, FloatArray]:
    """From the anchor of each landmark to where it is asked (T, 3) m, in the performer's heading."""
    limbs, standing = {}, asked.standing
    for name, entry in entries.items():
        limb = limb_scale(entry, standing) * (asked.mean(entry.follows) - asked.mean(entry.measured_from))
        limbs[name] = turned(limb, asked.heading) + entry.offset
    return limbs


def _stood(robot: RobotBody, stance: Stance, landmark: str) -> FloatArray:
    """The anchor (3,) m of a landmark in the stance."""
    return np.asarray(np.mean([stance.points[frame] for frame in robot.profile.landmarks[landmark].anchor], axis=0))


def hands_from_shoulders(robot: RobotBody, asked: ReferenceMotion, q: FloatArray, reached: FloatArray) -> FloatArray:
    """Landmarks reached (T, k, 3) m in postures (T, nq), with the hands where they would be if the robot's shoulders
    were where they are asked: what counts of a hand is how the arm holds it."""
    seen = reached.copy()
    entries = {name: robot.profile.landmarks[name] for name in HANDS if name in asked.landmark_names}
    for name, arm in asked_limbs(entries, asked).items():
        column = asked.landmark_names.index(name)
        shoulder = robot.points(q, entries[name].anchor).mean(axis=1)
        seen[:, column] += asked.landmarks[:, column] - arm - shoulder
    return seen


def headings(pelvis: FloatArray, joint_names: tuple[str, ...], joints: FloatArray, dt: float) -> FloatArray:
    """Unit vectors (T, 2) on the ground where a human faces, as the landmarks have them: by its pelvis (T, 4) wxyz and
    joints (T, m, 3) m, `dt` s apart."""
    at = {name: joints[:, joint_names.index(name)] for name in ("l_toe", "l_ankle", "r_toe", "r_ankle")}
    return _faced(pelvis, at["l_toe"] - at["l_ankle"], at["r_toe"] - at["r_ankle"], dt)


def _faced(pelvis: FloatArray, left: FloatArray, right: FloatArray, dt: float) -> FloatArray:
    """Headings (T, 2) by the pelvis (T, 4) wxyz and the lines (T, 3) of both feet."""
    facing = Facing()

    def faced(rows: slice) -> FloatArray:
        lines = zip(pelvis[rows].tolist(), left[rows].tolist(), right[rows].tolist(), strict=True)
        return np.array([facing.update(*line, dt) for line in lines]).reshape(-1, 2)

    return in_blocks(faced, len(pelvis))


def performer_facing(run: RunResult) -> FloatArray:
    """Heading (t, 2), unit vectors on the ground, in which a robot mirrors the performer at the ticks that followed."""
    found = performer_headings(run)
    return _held(found) if _goes_along(run) else found


def _goes_along(run: RunResult) -> bool:
    return run.robot is not None and run.robot.floats


def _held(heading: FloatArray) -> FloatArray:
    """The first of these headings (T, 2), for all of them."""
    return np.tile(heading[:1], (len(heading), 1))


def performer_headings(run: RunResult) -> FloatArray:
    """Unit vectors (t, 2) on the ground where the performer faces at the ticks that followed."""
    record, following = run.record, run.record.following
    turns = _pelvis_turns(run, record.human_q[following])
    return headings(turns, record.human_joint_names, record.human_joints[following], run.clip.dt)


def _pelvis_turns(run: RunResult, q: FloatArray) -> FloatArray:
    """Orientation (T, 4) wxyz of the human's pelvis in postures (T, nq)."""
    reader, pelvis = PostureReader(run.human), ORIENTED.index("pelvis")
    return in_blocks(lambda rows: reader.orientations(np.ascontiguousarray(q[rows]))[:, pelvis], len(q))


def robot_headings(robot: RobotBody, q: FloatArray, dt: float) -> FloatArray:
    """Unit vectors (T, 2) on the ground where a robot faces in postures (T, nq), `dt` s apart, by its pelvis and feet
    as a human does."""
    stood, feet = plant(robot, robot.profile.postures.stand).q, robot.profile.feet.values()
    frame = (pelvis_frame(robot),)
    turn = rotations.multiply(
        robot.orientations(q, frame)[:, 0], rotations.conjugate(robot.orientations(stood[None], frame)[:, 0])
    )
    lines = [rotations.rotate(robot.orientations(q, (foot.frame,))[:, 0], np.array([1.0, 0.0, 0.0])) for foot in feet]
    left, right = lines if len(lines) == 2 else np.zeros((2, len(q), 3))
    return _faced(turn, left, right, dt)


def pelvis_frame(robot: RobotBody) -> str:
    """The frame that travels with a robot: its pelvis, or its trunk where the profile has none."""
    return PELVIS if PELVIS in robot.profile.frames else TRUNK


def turn_extent(heading: FloatArray) -> float:
    """How far a heading (T, 2) turned, rad, from one end of its range to the other, whole turns counted."""
    return extent(np.unwrap(np.arctan2(heading[:, 1], heading[:, 0])))


def asked_feet(robot: RobotBody, asked: ReferenceMotion) -> dict[str, FloatArray]:
    """Frame of each sole -> the ankle (T, 3) m that it follows, in the performer's world and the size of the robot: a
    planted robot is asked to stay where it is, its performer is not."""
    entries = {entry.frame: entry for entry in robot.profile.landmarks.values()}
    feet = [foot.frame for foot in robot.profile.feet.values() if foot.frame in entries]
    return {frame: limb_scale(entries[frame], asked.standing) * asked.mean(entries[frame].follows) for frame in feet}


def turned(points: FloatArray, heading: FloatArray) -> FloatArray:
    """Points or vectors (T, ..., 3) of a world in which each row faces (T, 2), as seen by a viewer who faces x."""
    x, y = (column.reshape(-1, *[1] * (points.ndim - 2)) for column in heading.T)
    a, b, c = np.moveaxis(points, -1, 0)
    return np.stack([x * a + y * b, x * b - y * a, c], axis=-1)


def _torso(shoulders: Mapping[str, FloatArray], pelvis: FloatArray) -> FloatArray:
    """Axes (..., 3, 3), as columns, of a torso with these shoulders and this pelvis (..., 3): left, forward, up."""
    left, right = (shoulders[name] for name in HANDS)
    across, up = left - right, 0.5 * (left + right) - pelvis
    left_axis = across / np.linalg.norm(across, axis=-1, keepdims=True)
    forward = np.cross(left_axis, up)
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    return np.stack([left_axis, forward, np.cross(forward, left_axis)], axis=-1)


# How well hands are followed where the robot's arms can get there at all.

EVERY = 20
"""Ticks from one that is looked at to the next: a search is slow, and reach changes slowly."""
WITHIN_M = 0.002
"""The arm gets there when it gets this near, m."""
SEEDS, TRIES = 500, 12
"""Postures of the arm, spread over its ranges, of which the nearest begin a search each: one may end in a corner."""
AWAY_M = 0.15
"""A hand that is farther off than this, m, is not where the performer's is, on a robot of any size."""
STEPS = 40
"""Iterations of a search: it has a far way to go, from a posture that only lies near."""


@dataclass(frozen=True)
class Reachable:
    """One hand. share: of the ticks that ask for it, those within reach; error: mean distance (m) at those, or None;
    away: longest time (s) that it was farther off than `AWAY_M`, within reach."""

    share: float
    error: float | None
    away: float


def reachable_hands(robot: RobotBody, asked: ReferenceMotion, reached: FloatArray) -> dict[str, Reachable]:
    """How each hand followed at the ticks at which it was asked within reach; reached (T, k, 3) m: as the landmarks.

    Within reach: from the torso that is asked, the arm gets there within the position limits of its joints, at any
    speed. Where the robot was takes no part in that.
    """
    stance, found = plant(robot, robot.profile.postures.stand), {}
    for name, places in asked_arms(robot, stance, asked).items():
        column = asked.landmark_names.index(name)
        off = np.linalg.norm(reached[:, column] - asked.landmarks[:, column], axis=1)
        error, looked = off[::EVERY], np.zeros(len(off[::EVERY]), dtype=np.bool_)
        known = np.isfinite(error)
        looked[known] = within = within_reach(robot, stance, name, places[::EVERY][known])
        away = np.repeat(looked, EVERY)[: len(off)] & (off > AWAY_M)
        found[name] = Reachable(
            share=float(within.mean()) if within.size else 0.0,
            error=float(error[looked].mean()) if looked.any() else None,
            away=asked.dt * longest(away),
        )
    return found


def longest(holds: BoolArray) -> int:
    """How many values (T,) in a row are true, at most."""
    return max((end - first for first, end in motion_metrics.spans(holds)), default=0)


def within_reach(robot: RobotBody, stance: Stance, landmark: str, places: FloatArray) -> BoolArray:
    """Whether (T,) the limb of a landmark gets to each place (T, 3) m while the rest stays in its stance."""
    body, frame = robot.body, robot.profile.landmarks[landmark].frame
    place, moving = robot.frame(frame), body.joint_dof[list(chain_to_anchor(robot, landmark))]
    lower, upper = position_limits(robot)
    seeds = arm_postures(robot, stance, landmark, SEEDS)
    starts = robot.points(seeds, (frame,))[:, 0]
    solver = _arm_solver(robot, place.body, place.position, moving, lower, upper)

    def gets_to(at: FloatArray) -> bool:
        for seed in np.argsort(np.linalg.norm(starts - at, axis=1))[:TRIES]:
            solver.reset(seeds[seed])
            solver.frame(np.concatenate([[1.0], at]), 1.0)
            if solver.task_errors[0] <= WITHIN_M:
                return True
        return False

    return np.array([gets_to(at) for at in places], dtype=np.bool_)


def _arm_solver(
    robot: RobotBody, link: int, point: FloatArray, moving: NDArray[np.int64], lower: FloatArray, upper: FloatArray
) -> _solver.Solver:
    """One task, only the DoFs `moving` (d,) free, position limits (nv,), no others."""
    body = robot.body
    locked = np.ones(body.nv, dtype=np.bool_)
    locked[moving] = False
    unlimited = np.full(body.nv, np.inf)
    x, y, z = point.tolist()
    return _solver.Solver(
        body.solver_body(),
        [[_solver.Task.position(link, (x, y, z))]],
        lower=lower,
        upper=upper,
        max_velocity=unlimited,
        max_acceleration=unlimited,
        locked=locked,
        n_ik=STEPS,
    )
