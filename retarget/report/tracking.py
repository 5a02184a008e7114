"""Tracking of a performer by a run: errors, lag, reach of the hands, and the error of the highest level."""

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
from retarget.schema.priorities import AxisTask, CentreOfMassTask, OrientationTask, PositionTask, Task
from retarget.schema.profile_parts import Landmark
from retarget.types import ORIENTED, BoolArray, FloatArray

STILL_M = 1e-3
"""Shortest desired path, m, that has a ratio."""
ENDS = (2.0, 98.0)
"""Percentiles that bound a range, so that single bad frames do not count."""
LONGEST_LAG_S = 1.0
COARSE = 4
"""Step, ticks, of the coarse search for a lag."""


def distances(desired: FloatArray, actual: FloatArray) -> FloatArray:
    """Distances (T, k) m between tracks (T, k, 3)."""
    return np.asarray(np.linalg.norm(actual - desired, axis=-1))


def path_ratio(desired: FloatArray, actual: FloatArray) -> float | None:
    """Length of the actual paths over the desired ones, tracks (T, k, 3); None if nothing was to move."""
    known = _known(desired, actual)
    if np.count_nonzero(known) < 2:
        return None
    size = _path_length(desired[known])
    return None if size < STILL_M else _path_length(actual[known]) / size


def _known(*tracks: FloatArray) -> BoolArray:
    def known(rows: slice) -> BoolArray:
        return np.asarray(np.all([np.isfinite(track[rows]).all(axis=(1, 2)) for track in tracks], axis=0))

    return in_blocks(known, len(tracks[0]))


def excursion_ratio(desired: FloatArray, actual: FloatArray) -> float | None:
    """Range of actual over desired heights (T,) m; None if nothing was to move."""
    known = np.isfinite(desired) & np.isfinite(actual)
    size = extent(desired[known])
    return None if size < STILL_M else extent(actual[known]) / size


def extent(values: FloatArray) -> float:
    """Diagonal of the ranges of values (T,) or (T, k), within `ENDS`; 0 without any."""
    rows = values if values.ndim == 2 else values[:, None]
    known = rows[np.isfinite(rows).all(axis=1)]
    low, high = np.percentile(known, ENDS, axis=0) if len(known) else np.zeros((2, 1))
    return float(np.linalg.norm(high - low))


FOOT_S = 0.1
"""Interval, s, of foot samples, short against a swing."""
FOOT_M = 0.003
"""Distance, m, in FOOT_S up to which a foot stands."""


def foot_path_ratio(desired: FloatArray, actual: FloatArray, dt: float) -> float | None:
    """Like `path_ratio`, of feet, without their motion in stance. dt: s."""
    every = max(round(FOOT_S / dt), 1)
    known = np.isfinite(desired).all(axis=(1, 2)) & np.isfinite(actual).all(axis=(1, 2))
    paths = []
    for track in (desired, actual):
        steps = np.linalg.norm(np.diff(track[known][::every], axis=0), axis=-1)
        paths.append(float(steps[steps > FOOT_M].sum()))
    return paths[1] / paths[0] if paths[0] > 0.0 else None


def lag(desired: FloatArray, actual: FloatArray, dt: float) -> float | None:
    """Delay, s, of the actual tracks (T, k, 3) behind the desired ones, at the highest cross-correlation of all
    coordinates about their means. None if either stands still, or the correlation still rises at LONGEST_LAG_S."""
    known = np.flatnonzero(_known(desired, actual))
    whole = known.size > 0 and known[-1] - known[0] + 1 == known.size  # then a view of the track, which may be long
    rows = slice(known[0], known[-1] + 1) if whole else known
    a, b = (track[rows].reshape(-1, 3 * track.shape[1]) for track in (desired, actual))
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
    """RMS distance of (T, c) from its mean, m."""
    return float(np.sqrt(_inner(track, track)[0] / len(track)))


def _correlation(desired: FloatArray, actual: FloatArray, step: int) -> float:
    both, a, b = _inner(desired[: len(desired) - step], actual[step:])
    size = float(np.sqrt(a * b))
    return both / size if size > 0.0 else 0.0


def _inner(a: FloatArray, b: FloatArray) -> tuple[float, float, float]:
    """Sums of products of (T, c) and (T, c) about their means: of both, and of each with itself. Threads of BLAS would
    contend."""
    means, sums = (a.mean(axis=0), b.mean(axis=0)), np.zeros(3)
    for rows in blocks(len(a)):
        x, y = a[rows] - means[0], b[rows] - means[1]
        sums += [np.einsum("ij,ij->", *pair) for pair in ((x, y), (x, x), (y, y))]
    both, first, second = sums.tolist()
    return both, first, second


def _vertex(score: FloatArray, best: int) -> float:
    """Peak of the parabola through three neighbours, in ticks from `best`; 0 at the ends."""
    if best in (0, len(score) - 1):
        return 0.0
    before, here, after = score[best - 1 : best + 2]
    bend = before - 2.0 * here + after
    return 0.0 if bend >= 0.0 else float(0.5 * (before - after) / bend)


def top_level_error(run: RunResult) -> float | None:
    """Largest error, m or rad, in the highest level of the last stage: of positions, centre of mass, flat soles and
    axes, on the postures that were sent."""
    if not run.setup.priorities:
        return None
    passive = ("reactive", "preventive", "posture")
    levels = ([task for task in level.tasks if task.type not in passive] for level in run.setup.priorities[-1].levels)
    tasks = next((tasks for tasks in levels if tasks), [])
    errors = [error for task in tasks for error in _errors(task, run)]
    known = [float(np.nanmax(error)) for error in errors if np.isfinite(error).any()]
    return max(known) if known else None


def _errors(task: Task, run: RunResult) -> Iterable[FloatArray]:
    robot, sent = run.robot, run.record.robot
    if isinstance(task, CentreOfMassTask):
        if robot is None or sent is None:
            yield run.record.balance_error
        elif task.mode == "support" and robot.stands:
            yield np.maximum(task.margin - motion_metrics.standing_of(robot, sent.q).margin, 0.0)
    elif isinstance(task, PositionTask):
        names, desired, actual = run.followed
        counts = np.array([float(weight > 0.0) for weight in task.weight])  # 1 for the rows that it asks for
        errors = in_blocks(lambda rows: distances(desired[rows] * counts, actual[rows] * counts), len(desired))
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
    """The error (T,) of a frame, NaN for a sole of a walking robot, which is no task of this level."""
    robot = run.robot
    walks = run.tally.walk is not None and run.tally.walk.steps > 0
    if not walks or robot is None or name not in {foot.frame for foot in robot.profile.feet.values()}:
        return error
    return np.full_like(error, np.nan)


# The reference of the hands depends on the performer and constants of the robot alone. A desired hand is the desired
# shoulder plus the performer's arm, scaled and in their heading (`landmarks`). So the desired shoulders follow from the
# hands, and with the pelvis they give the torso's orientation.

HANDS = ("l_hand", "r_hand")


@dataclass(frozen=True, eq=False)
class ReferenceMotion:
    """The performer and the landmarks that a robot was to follow.

    joints (T, m, 3) m and pelvis (T, 4) wxyz: of the human. landmarks (T, k, 3) m: desired. dt: s. travels: the robot
    turns with the performer, and so sees them in their first heading.
    """

    dimensions: HumanDimensions
    joint_names: tuple[str, ...]
    joints: FloatArray
    pelvis: FloatArray
    landmark_names: tuple[str, ...]
    landmarks: FloatArray
    dt: float
    travels: bool = False

    @cached_property
    def heading(self) -> FloatArray:
        """Unit vectors (T, 2) on the ground where the performer faces, as the robot sees them."""
        found = headings(self.pelvis, self.joint_names, self.joints, self.dt)
        return _held(found) if self.travels else found

    def of(self, rows: slice) -> "ReferenceMotion":
        """Some of the ticks, with their headings in the whole motion."""
        part = replace(self, joints=self.joints[rows], pelvis=self.pelvis[rows], landmarks=self.landmarks[rows])
        part.__dict__["heading"] = self.heading[rows]  # where `cached_property` keeps it: a heading follows all ticks
        return part

    @property
    def standing(self) -> dict[str, FloatArray]:
        """Position (3,) m of each joint of the upright performer."""
        return dict(zip(POINTS, self.dimensions.standing(), strict=True))

    def mean(self, names: Sequence[str]) -> FloatArray:
        """Mean position (T, 3) m of some joints."""
        return np.asarray(self.joints[:, [self.joint_names.index(name) for name in names]].mean(axis=1))


def reference_of(run: RunResult) -> ReferenceMotion | None:
    """The reference of the robot of a run; None without a robot."""
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
        travels=_travels(run),
    )


def hand_references(robot: RobotBody, stance: Stance, reference: ReferenceMotion) -> dict[str, FloatArray]:
    """Desired position (T, 3) m of each hand, in the torso frame of the stance. Empty without landmarks for both
    hands."""
    turn = torso_rotation(robot, stance, reference)
    if turn is None:
        return {}
    arms = limb_references({name: robot.profile.landmarks[name] for name in HANDS}, reference)
    return {name: _stood(robot, stance, name) + as_carried(turn, arm) for name, arm in arms.items()}


def torso_rotation(robot: RobotBody, stance: Stance, reference: ReferenceMotion) -> FloatArray | None:
    """Rotation (T, 3, 3) of the desired torso from the stance, in the performer's heading; None without landmarks for
    both hands."""
    if not set(HANDS) <= set(reference.landmark_names):
        return None
    if "pelvis" not in reference.landmark_names:
        return np.tile(np.eye(3), (len(reference.landmarks), 1, 1))
    place = {name: reference.landmarks[:, reference.landmark_names.index(name)] for name in (*HANDS, "pelvis")}
    arms = limb_references({name: robot.profile.landmarks[name] for name in HANDS}, reference)
    stood = {name: _stood(robot, stance, name) for name in HANDS}
    hips = stance.points[robot.profile.landmarks["pelvis"].frame]
    shoulders = {name: place[name] - arm for name, arm in arms.items()}
    return np.asarray(_torso(shoulders, place["pelvis"]) @ _torso(stood, hips).T)


def as_carried(turn: FloatArray, lines: FloatArray) -> FloatArray:
    """Lines (T, ..., 3) in a torso frame that is rotated (T, 3, 3) from its stance."""
    return np.asarray(np.einsum("tji,t...j->t...i", turn, lines))


def limb_references(entries: Mapping[str, Landmark], reference: ReferenceMotion) -> dict[str, FloatArray]:
    """Desired vector (T, 3) m of each limb, from anchor to landmark, in the performer's heading."""
    limbs, standing = {}, reference.standing
    for name, entry in entries.items():
        limb = limb_scale(entry, standing) * (reference.mean(entry.follows) - reference.mean(entry.measured_from))
        limbs[name] = turned(limb, reference.heading) + entry.offset
    return limbs


def _stood(robot: RobotBody, stance: Stance, landmark: str) -> FloatArray:
    return np.asarray(np.mean([stance.points[frame] for frame in robot.profile.landmarks[landmark].anchor], axis=0))


def hands_from_shoulders(robot: RobotBody, reference: ReferenceMotion, q: FloatArray, actual: FloatArray) -> FloatArray:
    """Actual landmarks (T, k, 3) m in postures (T, nq), with the hands as if the shoulders were at their targets."""
    seen = actual.copy()
    entries = {name: robot.profile.landmarks[name] for name in HANDS if name in reference.landmark_names}
    for name, arm in limb_references(entries, reference).items():
        column = reference.landmark_names.index(name)
        shoulder = robot.points(q, entries[name].anchor).mean(axis=1)
        seen[:, column] += reference.landmarks[:, column] - arm - shoulder
    return seen


def headings(pelvis: FloatArray, joint_names: tuple[str, ...], joints: FloatArray, dt: float) -> FloatArray:
    """Unit vectors (T, 2) on the ground where a human faces, by its pelvis (T, 4) wxyz and joints (T, m, 3) m. dt:
    s."""
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
    """Headings (t, 2) in which a robot sees the performer at the ticks that followed."""
    found = performer_headings(run)
    return _held(found) if _travels(run) else found


def _travels(run: RunResult) -> bool:
    return run.robot is not None and run.robot.floats


def _held(heading: FloatArray) -> FloatArray:
    return np.tile(heading[:1], (len(heading), 1))


def performer_headings(run: RunResult) -> FloatArray:
    """Headings (t, 2) of the performer at the ticks that followed."""
    record, following = run.record, run.record.following
    turns = _pelvis_turns(run, record.human_q[following])
    return headings(turns, record.human_joint_names, record.human_joints[following], run.clip.dt)


def _pelvis_turns(run: RunResult, q: FloatArray) -> FloatArray:
    reader, pelvis = PostureReader(run.human), ORIENTED.index("pelvis")
    return in_blocks(lambda rows: reader.orientations(np.ascontiguousarray(q[rows]))[:, pelvis], len(q))


def robot_headings(robot: RobotBody, q: FloatArray, dt: float) -> FloatArray:
    """Headings (T, 2) of a robot in postures (T, nq), by its pelvis and feet. dt: s."""
    stood, feet = plant(robot, robot.profile.postures.stand).q, robot.profile.feet.values()
    frame = (pelvis_frame(robot),)
    turn = rotations.multiply(
        robot.orientations(q, frame)[:, 0], rotations.conjugate(robot.orientations(stood[None], frame)[:, 0])
    )
    lines = [rotations.rotate(robot.orientations(q, (foot.frame,))[:, 0], np.array([1.0, 0.0, 0.0])) for foot in feet]
    left, right = lines if len(lines) == 2 else np.zeros((2, len(q), 3))
    return _faced(turn, left, right, dt)


def pelvis_frame(robot: RobotBody) -> str:
    """The pelvis of a robot, or its trunk without one."""
    return PELVIS if PELVIS in robot.profile.frames else TRUNK


def turn_extent(heading: FloatArray) -> float:
    """Range, rad, of a heading (T, 2), whole turns included."""
    return extent(np.unwrap(np.arctan2(heading[:, 1], heading[:, 0])))


def ankle_references(robot: RobotBody, reference: ReferenceMotion) -> dict[str, FloatArray]:
    """Desired ankle (T, 3) m of each sole frame, in the performer's world and the size of the robot."""
    entries = {entry.frame: entry for entry in robot.profile.landmarks.values()}
    feet = [foot.frame for foot in robot.profile.feet.values() if foot.frame in entries]
    return {
        frame: limb_scale(entries[frame], reference.standing) * reference.mean(entries[frame].follows) for frame in feet
    }


def turned(points: FloatArray, heading: FloatArray) -> FloatArray:
    """Points or vectors (T, ..., 3) in a frame that faces (T, 2) on the ground."""
    x, y = (column.reshape(-1, *[1] * (points.ndim - 2)) for column in heading.T)
    a, b, c = np.moveaxis(points, -1, 0)
    return np.stack([x * a + y * b, x * b - y * a, c], axis=-1)


def _torso(shoulders: Mapping[str, FloatArray], pelvis: FloatArray) -> FloatArray:
    """Axes (..., 3, 3) left, forward, up, as columns, of a torso with these shoulders and pelvis (..., 3)."""
    left, right = (shoulders[name] for name in HANDS)
    across, up = left - right, 0.5 * (left + right) - pelvis
    left_axis = across / np.linalg.norm(across, axis=-1, keepdims=True)
    forward = np.cross(left_axis, up)
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    return np.stack([left_axis, forward, np.cross(forward, left_axis)], axis=-1)


EVERY = 20
"""Ticks between two searches, which are slow, while reach changes slowly."""
WITHIN_M = 0.002
"""Distance, m, at which the arm is there."""
SEEDS, TRIES = 500, 12
"""Postures spread over the arm, and number of the nearest that begin a search, because of local minima."""
AWAY_M = 0.15
"""Distance, m, beyond which a hand is away, for a robot of any size."""
STEPS = 40  # iterations of a search, which begins far from its end


@dataclass(frozen=True)
class Reachable:
    """One hand. share: ticks with its target within reach; error: mean distance, m, at those, or None; away: longest
    time, s, beyond `AWAY_M`."""

    share: float
    error: float | None
    away: float


def reachable_hands(robot: RobotBody, reference: ReferenceMotion, actual: FloatArray) -> dict[str, Reachable]:
    """Tracking of each hand at the ticks with its target within reach from the desired torso, and within position
    limits. actual (T, k, 3) m."""
    stance, found = plant(robot, robot.profile.postures.stand), {}
    for name, places in hand_references(robot, stance, reference).items():
        column = reference.landmark_names.index(name)
        off = np.linalg.norm(actual[:, column] - reference.landmarks[:, column], axis=1)
        error, looked = off[::EVERY], np.zeros(len(off[::EVERY]), dtype=np.bool_)
        known = np.isfinite(error)
        looked[known] = within = within_reach(robot, stance, name, places[::EVERY][known])
        away = np.repeat(looked, EVERY)[: len(off)] & (off > AWAY_M)
        found[name] = Reachable(
            share=float(within.mean()) if within.size else 0.0,
            error=float(error[looked].mean()) if looked.any() else None,
            away=reference.dt * longest(away),
        )
    return found


def longest(holds: BoolArray) -> int:
    """Length of the longest run of true values (T,)."""
    return max((end - first for first, end in motion_metrics.spans(holds)), default=0)


def within_reach(robot: RobotBody, stance: Stance, landmark: str, places: FloatArray) -> BoolArray:
    """True (T,) where the limb of a landmark reaches each place (T, 3) m from the stance."""
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
    """A solver with one task, position limits (nv,), and the free DoFs `moving` (d,)."""
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
