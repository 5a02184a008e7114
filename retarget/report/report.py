"""The report of a run: its keys are a contract for everyone who reads it. What is not known is null, never invented."""

import json
import math
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

from retarget.live.stream_report import LiveReport, TimePercentiles
from retarget.report.motion_metrics import HeldBack, LimitViolations, ModeSwitches, PhysicsReport
from retarget.robot.walking.travel import WalkTally
from retarget.run.run_result import RefusedPair
from retarget.safety.contact import Presses
from retarget.schema.catalogue import HUMAN
from retarget.schema.files import make_folder, write_atomic

DIGITS = 6
"""Significant digits of every number."""


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
class HeatReport:
    """The servo of those that carry the robot that will be warm first, at the end of the run, if it went on so.

    temperature, at: degrees Celsius, and from which on it warns; per_minute: degrees; left_min: null where it stays
    cooler."""

    joint: str
    temperature: float
    at: float
    per_minute: float
    left_min: float | None


@dataclass(frozen=True)
class BusReport:
    """rate_hz: ticks per second, measured on the bus's clock, null where it was not. cycle_ms: wall time of a tick.

    faults: servos silent or alarmed, and a bus that died. longest_period_ms: between two ticks, on the bus's clock;
    missed_ticks: deadlines that passed without one. retries: requests that had to be repeated. hottest degrees Celsius,
    lowest_voltage V, null where no servo reported one. warms: of those that carry the robot, null in the first minute.
    """

    rate_hz: float | None
    cycle_ms: Percentiles
    faults: int
    longest_period_ms: float | None
    missed_ticks: int | None
    retries: int
    hottest: ServoExtreme | None
    lowest_voltage: ServoExtreme | None
    warms: HeatReport | None = None


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
    """reactive_share: of the ticks that followed, those in which one was in contact."""

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

    In physics, likeness, hands, heights, paths, travel and turns are those of the simulated body. Figures that compare
    with the performer are of the ticks that followed, lag included.
    """

    frames: int
    """Frames of the source that were played."""
    ticks: int
    """Ticks of the bus."""
    duration_s: float
    """Seconds to the end, braking and the path to rest included."""
    rate_hz: float
    """Ticks per second of the robot."""
    frames_per_s: float
    """Source frames per second of wall time in the loop."""
    solve_us: Percentiles
    """Thread CPU per tick, both stages."""
    reconstruct_us: Percentiles
    """Thread CPU per tick, the human's stage."""
    retarget_us: Percentiles | None = None
    """Thread CPU per tick, the robot's stage."""
    tracking_mm: dict[str, Spread]
    """Landmarks of a robot against their targets at the same tick; joints of a human against sensors."""
    lag_s: float | None
    """Delay at which targets and landmarks correlate best; null of a run that is too short."""
    hand_path_ratio: float | None = None
    """Length of the hands' paths over that of their targets: a frozen robot shows 0."""
    pelvis_excursion_ratio: float | None = None
    """The same ratio for the pelvis."""
    unsensed_mm: dict[str, float] | None = None
    """Joints without a sensor, against the recorded body."""
    min_clearance_mm: Clearances
    """Smallest distances on the body file's own geoms, by MuJoCo."""
    penetrating_frames: int | None
    """Ticks in which links overlap each other, an obstacle or the floor by more than 1 um."""
    gated_frames: int | None = None
    """Ticks in which the gate sent something else."""
    limit_violations: LimitViolations
    """Values beyond a limit by more than `motion_metrics.TOLERANCE`, by finite differences of the goals."""
    priority_violation_max: float | None
    """Largest error of a task of the highest level, mm or mrad."""
    com_outside_support_frames: int | None = None
    """Ticks with the centre of mass outside the hull of the soles."""
    foot_slide_mm: float | None = None
    """Farthest slide of a sole while it touched."""
    jerk_p95: float | None
    """Jerk of joints, rad/s^3."""
    fallen: bool | None = None
    """True if the robot fell in the simulation; null without one."""
    mode_switches_per_s: ModeSwitches | None = None
    """Changes of mode of observers, mean and worst."""
    bus: BusReport | None
    """Rate, periods, retries and faults of the bus; the hottest servo and the lowest voltage."""
    stop: StopReport
    """Last state of the run, and the reason of a stop."""
    sensors_mm: dict[str, Spread]
    """Joints of the reconstructed human against their sensors."""
    servo_tracking_mm: dict[str, Spread] | None = None
    """As `tracking_mm`, of where the servos were."""
    servo_error_deg: dict[str, Spread] | None = None
    """Distance of each servo from the goal of the tick before."""
    no_command_frames: int | None = None
    """Ticks without a goal, in which the gate braked; not among `gated_frames`."""
    likeness_deg: dict[str, Spread] | None = None
    """Angles between limbs of robot and performer: upper arms, forearms, thighs, shanks."""
    trunk_lean_deg: Spread | None = None
    """Angle between the leans of the trunks of robot and performer."""
    likeness_recorded_deg: dict[str, Spread] | None = None
    """The same limbs and `trunk_lean` against the recorded body; null where the file does not know it whole."""
    legs_away_s: dict[str, float] | None = None
    """Longest time that each thigh and shank was more than 45 degrees off, from the recorded body where it is known."""
    pelvis_height_mm: Spread | None = None
    """Height of the pelvis above or below its target."""
    best_likeness_deg: dict[str, Spread] | None = None
    """Likeness of arms and `trunk_lean` at the best posture of each instant that limits and self-collision allow; null
    where it was not asked for."""
    travelled_m: BothMoved
    """Diagonal of the ground that the pelvis covers."""
    turned_deg: BothMoved
    """Range of the heading, which is low-passed."""
    foot_path_ratio: float | None = None
    """Length of the feet's paths over the performer's."""
    reachable_hands_mm: dict[str, float] | None = None
    """Mean error of each hand, seen from its shoulder, of both, and of the worse, in ticks in which the arm is long
    enough to reach its target from the planned torso."""
    reachable_share: dict[str, float] | None = None
    """Share of such ticks among those that followed."""
    hands_away_s: dict[str, float] | None = None
    """Longest time that each hand was more than 150 mm off in such ticks."""
    unfollowed: tuple[Unfollowed, ...] | None
    """Postures of the performer that the robot cannot take, with their times, from the recorded body where it is known;
    null of a robot that does not stand on planted soles, or whose legs do not follow."""
    com_margin_mm: float | None = None
    """Smallest distance of the centre of mass from the edge of the soles."""
    soles: Soles | None = None
    """Worst height and tilt of the soles."""
    closest_links: tuple[str, str] | None
    """The links that came closest."""
    refused_pair: RefusedPair | None = None
    """Links, or link and obstacle, for which the gate refused goals in most ticks; null where it refused none."""
    presses: Presses | None = None
    """Times that the robot held because it pressed against something, and the greatest press; null: it did not."""
    held_back: tuple[HeldBack, ...] = ()
    """Limbs that a joint at its limit, or an observer in contact, holds back in most ticks, and which one."""
    deep: DeepReport
    """Overlaps of more than 1 mm, and the links of the other clearances."""
    observers: ObserversReport | None = None
    """Share of ticks in which an observer was in contact."""
    physics: PhysicsReport | None
    """Falls in the simulation, `toppled` at rest, centre of pressure, slip, torque, temperature."""
    imu: ImuReport | None = None
    """Tilt by the IMU; null without one."""
    walk: WalkTally | None = None
    """Steps of a robot that makes some."""
    live: LiveReport | None
    """Frames of a stream, dropped ones with reasons, lost sensors, holds; null of a file."""
    latency_ms: dict[str, TimePercentiles] | None
    """Delay of a hand's motion on its path to the shafts, by stage, see `retarget.report.latency`."""
    hand_to_shaft_ms: TimePercentiles | None
    """Delay of the whole path."""
    robot: str
    """Robot of the run."""
    source: str
    """Motion file or address."""
    performer: str
    """Sensors that were followed."""
    priorities: tuple[str, ...]
    """Priority files of both stages."""
    speed: float
    """1 is the performer's."""
    notes: tuple[str, ...]
    """Guesses, warnings, and what was left out."""

    @property
    def lag_ms(self) -> float | None:
        """The lag of a robot, ms; None of a human alone."""
        return None if self.robot == HUMAN or self.lag_s is None else 1e3 * self.lag_s

    def as_json(self) -> str:
        """The report as JSON text; numbers that are not finite become null."""
        return json.dumps(plain(self), indent=2, allow_nan=False) + "\n"


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
