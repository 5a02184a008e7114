"""The report of a run: its keys are a contract for everyone who reads it. What is not known is null, never invented."""

import json
import math
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

from retarget.errors import UsageError
from retarget.live.stream_report import LiveReport, TimePercentiles
from retarget.report.motion_metrics import LimitViolations, ModeSwitches, PhysicsReport
from retarget.run.run_result import RefusedPair
from retarget.schema.files import check_folder, check_path, check_place, make_folder, write_atomic

DIGITS = 6
"""Significant digits of every number."""
FILE_NAME, PAGE_NAME = "report.json", "report.html"


@dataclass(frozen=True)
class Spread:
    """Errors over a run, in the unit that the key names."""

    mean: float
    p95: float
    max: float


@dataclass(frozen=True)
class BothMoved:
    """The same of performer and robot; null where it is not known."""

    performer: float | None
    robot: float | None


@dataclass(frozen=True)
class Percentiles:
    """Costs over the ticks of a run."""

    p50: float
    p99: float
    max: float


@dataclass(frozen=True)
class Clearances:
    """Smallest distances, mm, negative inside. self: between links of the robot. scene: to fixtures. ground: of links
    without a sole to what the robot stands on."""

    self: float | None
    scene: float | None
    ground: float | None


@dataclass(frozen=True)
class ServoExtreme:
    """The servo of this joint had the most, or the least, of all ticks."""

    joint: str
    value: float


@dataclass(frozen=True)
class BusReport:
    """rate_hz: ticks per second, measured on the bus's clock, null where it was not. cycle_ms: wall time of a tick.

    faults: servos silent or alarmed, and a bus that died. longest_period_ms: between two ticks, on the bus's clock;
    missed_ticks: deadlines that passed without one. retries: requests that had to be repeated. hottest degrees Celsius,
    lowest_voltage V, null where no servo reported one.
    """

    rate_hz: float | None
    cycle_ms: Percentiles
    faults: int
    longest_period_ms: float | None
    missed_ticks: int | None
    retries: int
    hottest: ServoExtreme | None
    lowest_voltage: ServoExtreme | None


@dataclass(frozen=True)
class StopReport:
    """How the run ended. state: the guard's, null where there is none; reason: why it ended early, else null."""

    state: str | None
    reason: str | None


@dataclass(frozen=True)
class DeepReport:
    """frames: ticks of `penetrating_frames` that go deeper than 1 mm. obstacle: the link and the obstacle of the scene
    clearance; ground: those of the ground clearance."""

    frames: int | None
    obstacle: tuple[str, str] | None
    ground: tuple[str, str] | None


@dataclass(frozen=True)
class ObserversReport:
    """clearance_mm: smallest distances of the observers' own shapes. activations: how often one became active.

    reactive_share: of the ticks that followed, those in which one was in contact.
    """

    clearance_mm: Clearances
    activations: int
    reactive_share: float


@dataclass(frozen=True)
class Soles:
    """Worst of all soles over the run. height_mm: distance from the ground; tilt_deg: from being flat."""

    height_mm: float
    tilt_deg: float


@dataclass(frozen=True)
class ImuReport:
    """The link of the IMU by what it measured. tilt_deg: from the vertical, at most; off_plan_deg: of its vertical from
    that in the posture that was sent. invalid: ticks without a valid measurement."""

    tilt_deg: float
    off_plan_deg: Spread | None
    invalid: int


@dataclass(frozen=True)
class StepsReport:
    """asked: times that the performer stood on one foot; made: times that the robot did; declined: all others, in which
    it stayed planted."""

    asked: int
    made: int
    declined: int


@dataclass(frozen=True)
class Unfollowed:
    """A posture of the performer that a robot on planted soles cannot take.

    what: "kneels", "lies or sits on the floor" or "jumps". from_s, to_s: on the time of the run.
    """

    what: str
    from_s: float
    to_s: float


@dataclass(frozen=True, kw_only=True)
class Report:
    """One run. Keys up to `stop` are stable; those after it say more and may grow.

    frames: of the source. ticks: of the bus. frames_per_s: source frames per second of wall time in the loop. solve_us,
    reconstruct_us, retarget_us: thread CPU per tick. tracking_mm: of a robot, landmark sent against landmark asked at
    the same tick, lag included; of a human, joint against sensor. lag_s: of the same. unsensed_mm: joints without
    sensor, against the recorded body. priority_violation_max: largest error of a task of the highest level, mm or mrad.
    min_clearance_mm: on the body's own geoms; penetrating_frames: ticks in which they are in each other or in the
    scene, by anything. closest_links: what came closest. refused_pair: null where no goal was refused for a pair.
    mode_switches_per_s: of observers, mean and worst. limit_violations: values beyond a limit by more than
    `motion_metrics.TOLERANCE`. jerk_p95: rad/s^3.

    sensors_mm: as tracking_mm, of the reconstructed human. servo_tracking_mm: as tracking_mm, of where the servos were.
    servo_error_deg: how far each servo stood from the goal of the tick before. no_command_frames: ticks without a goal,
    in which the gate braked; not among gated_frames. likeness_deg: angles between limbs of the robot and of the
    performer; trunk_lean_deg: how far the trunk leans from where the performer's does; both while it followed.
    likeness_recorded_deg: the same limbs and `trunk_lean` against the recorded body, in the heading of the
    reconstruction; null where the file does not know it whole. legs_away_s: longest time that each thigh and shank was
    more than 45 degrees off, from the recorded body where it is known. pelvis_height_mm: how much too high or low the
    pelvis was. best_likeness_deg: the same of arms and `trunk_lean` at their best, as far as limits and self-collision
    allow with the trunk as asked; null where it was not asked for. travelled_m: diagonal of the ground that the pelvis
    covers; turned_deg: range of the heading; foot_path_ratio: of feet, against the performer's. In physics, likeness,
    hands, heights, paths, travel and turns are those of the simulated body. reachable_hands_mm: mean error of each
    hand, seen from its shoulder, of both, and of the worse, at the ticks at which it was asked where the arm gets from
    the torso that was asked; reachable_share: of the ticks that followed, those; hands_away_s: longest time that each
    hand was more than 150 mm off at such ticks.
    unfollowed: postures of the performer that the robot cannot take, with their times, from the recorded body where it
    is known; null of a robot that does not stand on planted soles, or whose legs do not follow.
    fallen, physics: as the simulation saw it; null without.
    imu: null where there is none. steps: null of a robot that makes none. live: of the stream, null of a file.
    latency_ms: by stage, and hand_to_shaft_ms: of the whole way, see `retarget.report.latency`.
    """

    frames: int
    ticks: int
    duration_s: float
    rate_hz: float
    frames_per_s: float
    solve_us: Percentiles
    reconstruct_us: Percentiles
    retarget_us: Percentiles | None = None
    tracking_mm: dict[str, Spread]
    lag_s: float | None
    hand_path_ratio: float | None = None
    pelvis_excursion_ratio: float | None = None
    unsensed_mm: dict[str, float] | None = None
    min_clearance_mm: Clearances
    penetrating_frames: int | None
    gated_frames: int | None = None
    limit_violations: LimitViolations
    priority_violation_max: float | None
    com_outside_support_frames: int | None = None
    foot_slide_mm: float | None = None
    jerk_p95: float | None
    fallen: bool | None = None
    mode_switches_per_s: ModeSwitches | None = None
    bus: BusReport | None
    stop: StopReport
    sensors_mm: dict[str, Spread]
    servo_tracking_mm: dict[str, Spread] | None = None
    servo_error_deg: dict[str, Spread] | None = None
    no_command_frames: int | None = None
    likeness_deg: dict[str, Spread] | None = None
    trunk_lean_deg: Spread | None = None
    likeness_recorded_deg: dict[str, Spread] | None = None
    legs_away_s: dict[str, float] | None = None
    pelvis_height_mm: Spread | None = None
    best_likeness_deg: dict[str, Spread] | None = None
    travelled_m: BothMoved
    turned_deg: BothMoved
    foot_path_ratio: float | None = None
    reachable_hands_mm: dict[str, float] | None = None
    reachable_share: dict[str, float] | None = None
    hands_away_s: dict[str, float] | None = None
    unfollowed: tuple[Unfollowed, ...] | None
    com_margin_mm: float | None = None
    soles: Soles | None = None
    closest_links: tuple[str, str] | None
    refused_pair: RefusedPair | None = None
    deep: DeepReport
    observers: ObserversReport | None = None
    physics: PhysicsReport | None
    imu: ImuReport | None = None
    steps: StepsReport | None = None
    live: LiveReport | None
    latency_ms: dict[str, TimePercentiles] | None
    hand_to_shaft_ms: TimePercentiles | None
    robot: str
    source: str
    performer: str
    priorities: tuple[str, ...]
    speed: float
    notes: tuple[str, ...]

    def as_json(self) -> str:
        """The report as JSON text; numbers that are not finite become null."""
        return json.dumps(plain(self), indent=2, allow_nan=False) + "\n"


def report_path(text: str | Path) -> Path:
    """Path of a report: FILE.json, or `report.json` in a folder, which need not be there yet.

    Raises UsageError if it cannot be written there.
    """
    path = Path(text)
    check_path(path, option="--report")
    page = page_path(path)
    if page is not None:
        check_folder(page.parent, option="--report")
        return page.with_name(FILE_NAME)
    if path.suffix.lower() != ".json":
        raise UsageError(
            "a report is a JSON file, or a folder with that and a page",
            where="--report",
            found=str(path),
            allowed="FILE.json, or a folder",
            next_step=f"Give {path.with_suffix('.json').name}, or {path.stem} for both",
        )
    check_place(path, option="--report")
    return path


def page_path(text: str | Path) -> Path | None:
    """Path of the page of a report: `report.html` in the folder that is given; None where a file is meant.

    A name that is not there yet is a folder's, unless it ends like a file's.
    """
    path = Path(text)
    return path / PAGE_NAME if path.is_dir() or not path.suffix[1:].isalpha() else None


def write_report(report: Report, path: Path) -> None:
    """Write a report, whole or not at all, into its folder, made if need be. Raises UsageError if that cannot be."""
    make_folder(path.parent, option="--report")
    write_atomic(path, report.as_json().encode(), option="--report")


def plain(value: Any) -> Any:
    """Data for JSON: dataclasses as objects, numbers rounded, null for what is not finite."""
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None
    return value
