"""A neutral judge of a robot's motion from any program, by the figures of the report and thresholds in the size of the
robot."""

from dataclasses import dataclass, replace
from math import ceil
from typing import Any

import numpy as np

from hardware.bus import ServoBus
from hardware.clock import Clock, VirtualClock
from retarget.frames import SensorFrames
from retarget.human.samples import Playback
from retarget.human.support_phase import CarryingFeet
from retarget.ik.support_polygon import plant
from retarget.model.human import PostureReader
from retarget.model.robot import RobotBody, load_robot
from retarget.model.scene_state import SceneState
from retarget.recording.motion import MAX_FPS, Motion, posture, resampled
from retarget.report import tracking
from retarget.report.clearance import Clearance, robot_clearances
from retarget.report.findings import findings, gap_words
from retarget.report.likeness import frozen_share
from retarget.report.lines import Finding, lines_of
from retarget.report.measure import measure
from retarget.report.motion_metrics import (
    CONTACT_M,
    OUTSIDE_M,
    BeyondLimit,
    Standing,
    beyond_limits,
    foot_slide,
    jerk_p95,
    shake_share,
    standing_of,
    support_margin,
    zero_moment_points,
)
from retarget.report.report import Report
from retarget.robot.follower import Follower
from retarget.robot.landmarks import PELVIS
from retarget.rotations import from_axis_angle, multiply, rotate
from retarget.run.options import RunOptions
from retarget.run.prepare import performance_of, prepare_for, scene_of, stage_priorities
from retarget.run.run_result import RunResult, RunSetup
from retarget.schema.catalogue import HUMAN
from retarget.types import MM, FloatArray, HumanPosture

SWEPT_HZ = 240.0
"""Rate, Hz, of postures in clearance checks: a hand at 2 m/s moves by 8 mm."""
FILE_ROUND_OFF = 1e-6
"""Round-off, rad, of joint positions in single precision, or with nine decimals."""
SLIDE = 0.03
"""Slide of a sole that is allowed, as a share of the root's height: 2 cm for a robot of 1.3 m."""
IN_AIR, OUTSIDE = 0.1, 0.05
"""Allowed shares of the time without a sole on the floor, and beyond balance: a hop, and the ends of the window of
accelerations."""
SHAKES, FROZEN, ASLEEP = 0.1, 0.2, 0.9
"""Limits of the share of power above human motion, and of the time in which the robot is frozen: beside a moving
performer, and of all time."""
NEARLY_FLAT = np.deg2rad(10.0)
"""Tilt, rad, from which a sole settles on the floor: two servos of a leg yield as much."""
SPIKES, RESAMPLED = 0.005, 1.05
"""Allowed share of ticks beyond the limit of joint accelerations, and factor of that limit. Linear resampling causes as
much."""
ASLEEP_RAD_S = 0.01
"""Joint speed, rad/s, below which a robot does not move: a degree in two seconds."""


@dataclass(frozen=True)
class Nearness:
    """clearance_mm: least distance, negative inside. deep_share: of the time more than 1 mm inside. pair: the
    closest."""

    clearance_mm: float | None
    deep_share: float
    pair: tuple[str, str] | None


@dataclass(frozen=True)
class Feet:
    """slide_mm: largest slide of a sole; air_share: of the time without touch; air_mm: greatest height of the lowest
    corner; sink_mm: depth of the deepest. com_outside_share, zmp_outside_share: of the ticks with touch, those with the
    centre of mass, or zero-moment point, outside the soles."""

    slide_mm: float
    air_share: float
    air_mm: float
    sink_mm: float
    com_outside_share: float | None
    zmp_outside_share: float | None


@dataclass(frozen=True)
class Judgement:
    """A motion, its figures, and the lines of the table.

    limits: of position, velocity and acceleration. clearance: to `self`, `scene` and `ground`. jerk_p95: rad/s^3.
    frozen_share: of the performer's moving time, or of all time. Shares are from 0 to 1; null: not known.
    """

    file: str
    layout: str
    robot: str
    performer: str | None
    rows: int
    rate_hz: float
    from_s: float
    duration_s: float
    limits: dict[str, BeyondLimit]
    clearance: dict[str, Nearness]
    feet: Feet | None
    jerk_p95: float | None
    shake_share: float | None
    frozen_share: float | None
    report: Report | None
    lines: tuple[Finding, ...]
    verdict: str
    notes: tuple[str, ...]

    @property
    def lost(self) -> tuple[Finding, ...]:
        """The lines that are not kept."""
        return tuple(line for line in self.lines if line.kept is False)


def judge(
    motion: Motion, robot: RobotBody, *, layout: str, source: SensorFrames | None = None, scene: str | None = None
) -> Judgement:
    """Judge a motion of a robot. source: its performer from the same moment on; scene: by name or file.

    Raises InputError for unevenly spaced rows; ConfigError and UsageError for a scene, and for an unusable performer.
    """
    dt, q = 1.0 / motion.rate_hz, _postures(motion, robot)
    names, positions = robot.joint_map.joints, q[:, robot.servo_columns]
    limits = replace(robot.limits, max_acceleration=RESAMPLED * robot.limits.max_acceleration)
    world = scene_of(robot, RunOptions(robot=robot.profile.name, scene=scene))
    height = float(plant(robot, robot.profile.postures.stand).q[2]) if robot.stands else 0.0
    run = None if source is None else beside(motion, robot, source)
    report, reference = (None, None) if run is None else (measure(run), tracking.reference_of(run))
    still: float | None
    if run is None or reference is None:
        still = float((np.abs(np.diff(positions, axis=0)).max(axis=1) < ASLEEP_RAD_S * dt).mean())
    else:
        assert run.robot is not None and run.record.robot is not None, "a robot moves"
        still = frozen_share(run.robot, run.record.robot.q, reference)
    found = Judgement(
        file=motion.source,
        layout=layout,
        robot=robot.profile.name,
        performer=None if source is None else source.source,
        rows=len(motion),
        rate_hz=motion.rate_hz,
        from_s=float(motion.time[0]),
        duration_s=float(motion.time[-1] - motion.time[0]),
        limits=beyond_limits(names, positions, limits, dt, tolerance=FILE_ROUND_OFF),
        clearance=_nearness(motion, robot, world),
        feet=_feet(standing_of(robot, q), dt) if robot.stands else None,
        jerk_p95=jerk_p95(positions, dt),
        shake_share=shake_share(positions, dt),
        frozen_share=still,
        report=report,
        lines=(),
        verdict="",
        notes=motion.notes if run is None else (*motion.notes, *run.notes),
    )
    found = replace(found, lines=_lines(found, run, SLIDE * MM * height))
    return replace(found, verdict=_verdict(found))


def _postures(motion: Motion, robot: RobotBody) -> FloatArray:
    """Postures (T, nq) of the robot's own tree, which may have no free root."""
    if robot.body.root == "free":
        return posture(robot.body, motion.joint_names, motion.joints, motion.q[:, :7])
    q = np.tile(robot.body.qpos0, (len(motion), 1))
    q[:, [robot.body.joint_qpos[robot.body.joint_index(name)] for name in motion.joint_names]] = motion.joints
    return q


def _nearness(motion: Motion, robot: RobotBody, scene: SceneState | None) -> dict[str, Nearness]:
    between = max(min(ceil(SWEPT_HZ / motion.rate_hz), int(MAX_FPS / motion.rate_hz)), 1)
    swept = resampled(motion, between * motion.rate_hz) if between > 1 else motion
    parts = robot_clearances(robot, _postures(swept, robot), scene, swept.time - swept.time[0])

    def near(part: Clearance) -> Nearness:
        return Nearness(None if part.smallest is None else MM * part.smallest, part.deep / len(swept), part.pair)

    return dict(zip(("self", "scene", "ground"), map(near, parts), strict=True))


def _feet(stand: Standing, dt: float) -> Feet:
    """Balance counts soles as flat on the floor where they touch it and are nearly flat, as servos let them settle."""
    lowest = np.stack([corners[..., 2].min(axis=1) for corners in stand.soles], axis=1)  # (T, k) [m]
    bears = (lowest <= CONTACT_M) & (stand.tilt < NEARLY_FLAT)
    corners = stand.corners.copy()
    corners[np.repeat(bears, stand.sizes, axis=1), 2] = 0.0
    touching = (lowest <= CONTACT_M).any(axis=1)
    point = np.column_stack([zero_moment_points(stand.com, dt), np.zeros(len(lowest))])
    known = touching & np.isfinite(point).all(axis=1)
    outside, tips = (support_margin(of, corners) < -OUTSIDE_M for of in (stand.com, point))
    slides = [foot_slide(stand.place[:, sole], lowest[:, sole]) for sole in range(lowest.shape[1])]
    return Feet(
        slide_mm=MM * max(slides),
        air_share=float((~touching).mean()),
        air_mm=MM * max(float(lowest.min(axis=1).max()), 0.0),
        sink_mm=MM * max(-float(lowest.min()), 0.0),
        com_outside_share=float(outside[touching].mean()) if touching.any() else None,
        zmp_outside_share=float(tips[known].mean()) if known.any() else None,
    )


GOES_M, TURNS_DEG = 0.2, 30.0
"""Travel of a robot's soles, in heights of its root, and turn from which on it goes along with its performer; otherwise
it is planted."""


def beside(motion: Motion, robot: RobotBody, source: SensorFrames) -> RunResult:
    """A motion as a run that followed a performer, over the ticks that both have. Its place and heading on the floor,
    in which programs differ, bring the robot nearest to the desired landmarks."""
    q, dt, rate = _postures(motion, robot), 1.0 / motion.rate_hz, motion.rate_hz
    goes = _goes(robot, q)
    options = RunOptions(robot=robot.profile.name, legs="free" if goes else None)
    if goes:
        robot = load_robot(robot.profile.path, root="floating")
    human = _human_run(source, robot, rate, float(motion.time[-1] - motion.time[0]))
    _, for_robot, _ = stage_priorities(robot, options)
    assert for_robot is not None, "there is a robot"
    landmarks = Follower(robot, for_robot, human.human.dimensions).landmark_map
    ticks = min(len(q), len(human.record))
    record, q = human.record[:ticks], q[:ticks]
    turns = PostureReader(human.human).orientations(record.human_q)
    desired = np.empty((ticks, len(landmarks.names), 3))
    names, feet = record.human_joint_names, CarryingFeet()
    ankles = [names.index(f"{side}_ankle") for side in "lr"]
    for row in range(ticks):
        joints = record.human_joints[row]
        seen = HumanPosture(
            record.human_q[row], names, joints, turns[row], np.zeros(3), np.zeros(0), 0.0, (1.0, 0.0),
            carrying=feet.step(joints[ankles].tolist(), dt),
        )  # fmt: skip
        desired[row] = landmarks.desired(seen, dt).landmarks
    if robot.body.root == "free":
        q = _placed(robot, q, desired, landmarks.names, goes)
    goals = q[:, robot.servo_columns]
    none = np.zeros((ticks, 0), dtype=np.uint8)
    moved = replace(
        record, q=q, goals=goals, start=goals[0], observer_modes=none, landmarks_asked=desired,
        landmark_names=landmarks.names, from_start=False, to_end=False,
    )  # fmt: skip
    notes = human.notes
    if abs(len(motion) - len(human.record)) * dt > UNLIKE_S:
        both = f"the motion takes {len(motion) * dt:.1f} s, its performer {len(human.record) * dt:.1f} s"
        notes = (*notes, f"{both}: only what both have is compared")
    setup = RunSetup(human.setup.performer, (*human.setup.priorities, for_robot), has_bus=False)
    return replace(human, record=moved, robot=robot, setup=setup, notes=notes, observers=None)


UNLIKE_S = 0.5
"""Difference, s, of two durations that is not reported."""


def _human_run(source: SensorFrames, robot: RobotBody, rate: float, lasts: float) -> RunResult:
    """The performer, reconstructed as in a run. A calibration pose is part of the motion if the durations, `lasts` s,
    then match better."""
    options = RunOptions(robot=HUMAN, priorities=robot.profile.reconstruct)

    def clip(keep: bool) -> RunResult:
        playback = Playback(keep_calibration_frame=keep)
        perform = performance_of(lambda: source, playback, rate_hz=rate)
        with prepare_for(perform, options, clock=VirtualClock(), make_bus=_no_bus) as prepared:
            return prepared.run()

    found = clip(False)
    if found.clip.left_out is None:
        return found
    off = abs(len(found.clip) * found.clip.dt - lasts), abs(source.duration_s - lasts)
    return found if off[0] <= off[1] else clip(True)


def _no_bus(robot: RobotBody, clock: Clock) -> ServoBus:
    raise AssertionError("a human alone has no bus")


def _goes(robot: RobotBody, q: FloatArray) -> bool:
    if not robot.stands or PELVIS not in robot.profile.landmarks:
        return False
    place = standing_of(robot, q).place.mean(axis=1)[:, :2]
    far = GOES_M * float(plant(robot, robot.profile.postures.stand).q[2])
    return tracking.extent(place) > far or tracking.turn_extent(_sole_headings(robot, q)) > np.deg2rad(TURNS_DEG)


def _sole_headings(robot: RobotBody, q: FloatArray) -> FloatArray:
    frames = tuple(foot.frame for foot in robot.profile.feet.values())
    ahead = rotate(robot.orientations(q, frames), np.array([1.0, 0.0, 0.0]))[..., :2].mean(axis=1)
    return np.asarray(ahead / np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9))


def _placed(robot: RobotBody, q: FloatArray, desired: FloatArray, names: tuple[str, ...], goes: bool) -> FloatArray:
    """Postures (T, nq), moved as a whole on the floor: planted soles to where a robot stands, else landmarks to the
    desired ones (T, k, 3) m."""
    reached = robot.points(q, robot.landmark_frames(names))
    if goes:
        a, b = (points[..., :2] - points[..., :2].mean(axis=(0, 1)) for points in (reached, desired))
        x, y = float((a * b).sum()), float((a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]).sum())
        yaw = np.arctan2(y, x)
    elif robot.stands:
        x, y = _sole_headings(robot, q)[0]
        yaw = -np.arctan2(y, x)
    else:
        return q
    turn = from_axis_angle(np.array([0.0, 0.0, 1.0]), yaw)
    found = q.copy()
    found[:, :3], found[:, 3:7] = rotate(turn, q[:, :3]), multiply(turn, q[:, 3:7])
    if goes:
        middle = robot.points(found, robot.landmark_frames(names))[..., :2].mean(axis=(0, 1))
        found[:, :2] += desired[..., :2].mean(axis=(0, 1)) - middle
    else:
        found[:, :2] -= standing_of(robot, found[:1]).place[0, :, :2].mean(axis=0)
    return found


class JudgedFigures:
    """Figures of a judgement by the names of `findings.yaml`. most: bounds."""

    def __init__(self, found: Judgement, slide_mm: float) -> None:
        self.found = found
        self.most = {"spikes": SPIKES, "slide_mm": slide_mm, "air": IN_AIR, "sink_mm": MM * CONTACT_M}
        self.most |= {"outside": OUTSIDE, "shake": SHAKES, "frozen": ASLEEP if found.report is None else FROZEN}

    def __getattr__(self, name: str) -> Any:
        return getattr(self.found, name)

    @property
    def gaps(self) -> dict[str, str]:
        """The least distances and their pairs, in words."""
        known = {part: near for part, near in self.found.clearance.items() if near.clearance_mm is not None}
        return {part: gap_words(near.clearance_mm or 0.0, near.pair, inside="inside") for part, near in known.items()}

    @property
    def frozen_beside(self) -> float | None:
        """Frozen share of the time in which a performer moves."""
        return None if self.found.report is None else self.found.frozen_share

    @property
    def tracking(self) -> dict[str, float]:
        """Mean error of all landmarks, and of the worst."""
        means = [] if self.found.report is None else [one.mean for one in self.found.report.tracking_mm.values()]
        return {"mean": float(np.mean(means)), "worst": max(means)} if means else {}


FROM_REPORT = (
    "following",
    "likeness",
    "hands within reach",
    "hand path",
    "pelvis height",
    "foot path",
    "over the ground",
)
"""Lines of the report that apply to a motion beside its performer."""


def _lines(found: Judgement, run: RunResult | None, slide_mm: float) -> tuple[Finding, ...]:
    seen = JudgedFigures(found, slide_mm)
    known = () if run is None or found.report is None else findings(run, found.report)
    beside = (line for line in known if line.name in FROM_REPORT)
    return (*lines_of("judge", seen), *beside, *lines_of("beside", seen))


def _verdict(found: Judgement) -> str:
    judged = sum(line.kept is not None for line in found.lines)
    if not found.lost:
        return f"The motion keeps all {judged} lines that are judged."
    lost = "; ".join(f"{line.name}: {line.measured}" for line in found.lost)
    return f"The motion loses {len(found.lost)} of {judged} lines: {lost}."
