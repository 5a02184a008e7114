"""The report of a run. Its keys are a contract; unknown values are null."""

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
    """Errors over a run, in the unit of the key."""

    mean: float
    p95: float
    max: float


@dataclass(frozen=True)
class BothMoved:
    """A figure of performer and robot; null where it is not known."""

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
    """Smallest distances, mm, negative inside. self: of links. scene: to fixtures. ground: of links without a sole."""

    self: float | None
    scene: float | None
    ground: float | None


@dataclass(frozen=True)
class ServoExtreme:
    """The servo with the largest, or smallest, value of all ticks."""

    joint: str
    value: float


@dataclass(frozen=True)
class HeatReport:
    """The load-bearing servo that gets warm first if the run goes on. temperature, at: now and at its warning, degrees
    Celsius; left_min: null if it stays cooler."""

    joint: str
    temperature: float
    at: float
    per_minute: float
    left_min: float | None


@dataclass(frozen=True)
class BusReport:
    """rate_hz: ticks per second on the bus's clock. cycle_ms: wall time of a tick. faults: silent or alarmed servos,
    and bus failures. longest_period_ms: between two ticks; missed_ticks: deadlines without one. retries: repeated
    requests. hottest: degrees Celsius; lowest_voltage: V. warms: null in the first minute."""

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
    """The end of the run. state: the guard's; reason: of an early end, else null."""

    state: str | None
    reason: str | None


@dataclass(frozen=True)
class DeepReport:
    """frames: ticks deeper than 1 mm. obstacle, ground: pairs of the scene and ground clearances."""

    frames: int | None
    obstacle: tuple[str, str] | None
    ground: tuple[str, str] | None


@dataclass(frozen=True)
class ObserversReport:
    """reactive_share: of the ticks of following, those in contact."""

    reactive_share: float


@dataclass(frozen=True)
class Soles:
    """Worst of all soles. height_mm: from the ground; tilt_deg: from flat."""

    height_mm: float
    tilt_deg: float


@dataclass(frozen=True)
class ImuReport:
    """tilt_deg: largest tilt from the vertical; off_plan_deg: from the tilt in the posture that was sent. invalid:
    ticks without a valid measurement."""

    tilt_deg: float
    off_plan_deg: Spread | None
    invalid: int


@dataclass(frozen=True)
class Unfollowed:
    """A posture that a robot on planted soles cannot take. what: "kneels", "lies or sits on the floor" or "jumps".
    from_s, to_s: on the time of the run."""

    what: str
    from_s: float
    to_s: float


@dataclass(frozen=True, kw_only=True)
class Report:
    """One run. Keys up to `stop` are stable; later ones may grow.

    Physics, likeness, hands, heights, paths, travel and turns are those of the simulated body, if any. Comparisons with
    the performer count the ticks of following.
    """

    frames: int
    """Source frames played."""
    ticks: int
    """Ticks of the bus."""
    duration_s: float
    """Seconds, with braking and the rest trajectory."""
    rate_hz: float
    """Ticks per second."""
    frames_per_s: float
    """Source frames per second of wall time."""
    solve_us: Percentiles
    """Thread CPU per tick, both stages."""
    reconstruct_us: Percentiles
    """Thread CPU per tick, human stage."""
    retarget_us: Percentiles | None = None
    """Thread CPU per tick, robot stage."""
    tracking_mm: dict[str, Spread]
    """Landmarks of a robot to their targets; joints of a human to sensors."""
    lag_s: float | None
    """Delay with the highest correlation of targets and landmarks."""
    hand_path_ratio: float | None = None
    """Length of the hands' paths over their targets'."""
    pelvis_excursion_ratio: float | None = None
    """Range of the pelvis height over its target's."""
    unsensed_mm: dict[str, float] | None = None
    """Joints without a sensor, to the recorded body."""
    min_clearance_mm: Clearances
    """Smallest distances on the body file's geoms."""
    penetrating_frames: int | None
    """Ticks with overlaps by more than 1 um."""
    gated_frames: int | None = None
    """Ticks in which the gate changed the goal."""
    limit_violations: LimitViolations
    """Values beyond a limit, by finite differences of the goals."""
    priority_violation_max: float | None
    """Largest error in the highest level, mm or mrad."""
    com_outside_support_frames: int | None = None
    """Ticks with the centre of mass outside the soles."""
    foot_slide_mm: float | None = None
    """Largest slide of a touching sole."""
    jerk_p95: float | None
    """Jerk of joints, rad/s^3."""
    fallen: bool | None = None
    """True if the robot fell in the simulation."""
    mode_switches_per_s: ModeSwitches | None = None
    """Changes of observer modes, mean and worst."""
    bus: BusReport | None
    """Rate, periods, retries and faults of the bus; the hottest servo and the lowest voltage."""
    stop: StopReport
    """Last state, and the reason of a stop."""
    sensors_mm: dict[str, Spread]
    """Joints of the reconstructed human to their sensors."""
    servo_tracking_mm: dict[str, Spread] | None = None
    """Like `tracking_mm`, by the servos."""
    servo_error_deg: dict[str, Spread] | None = None
    """Distance of each servo from the goal of the tick before."""
    no_command_frames: int | None = None
    """Ticks without a goal, in which the gate braked; not in `gated_frames`."""
    likeness_deg: dict[str, Spread] | None = None
    """Angles between limbs of robot and performer."""
    trunk_lean_deg: Spread | None = None
    """Angle between the leans of both trunks."""
    likeness_recorded_deg: dict[str, Spread] | None = None
    """Limbs and `trunk_lean` against the recorded body; null if it is incomplete."""
    legs_away_s: dict[str, float] | None = None
    """Longest time of a thigh or shank more than 45 degrees off."""
    pelvis_height_mm: Spread | None = None
    """Error of the pelvis height."""
    best_likeness_deg: dict[str, Spread] | None = None
    """Likeness in the best postures that limits and self-collision allow; null without the option."""
    travelled_m: BothMoved
    """Diagonal of the ground that the pelvis covers."""
    turned_deg: BothMoved
    """Range of the low-passed heading."""
    foot_path_ratio: float | None = None
    """Length of the feet's paths over the performer's."""
    reachable_hands_mm: dict[str, float] | None = None
    """Mean error of hands, seen from the shoulder, in ticks with the target within reach."""
    reachable_share: dict[str, float] | None = None
    """Share of such ticks."""
    hands_away_s: dict[str, float] | None = None
    """Longest time of a hand more than 150 mm off in them."""
    unfollowed: tuple[Unfollowed, ...] | None
    """Postures that the robot cannot take; null for a robot without planted soles, or whose legs do not follow."""
    com_margin_mm: float | None = None
    """Smallest distance of the centre of mass from the edge of the soles."""
    soles: Soles | None = None
    """Worst height and tilt of the soles."""
    closest_links: tuple[str, str] | None
    """The links that came closest."""
    refused_pair: RefusedPair | None = None
    """The pair for which the gate refused most goals."""
    presses: Presses | None = None
    """Holds because the robot pressed against something, and the greatest press."""
    held_back: tuple[HeldBack, ...] = ()
    """Limbs restrained in most ticks by a joint limit or an observer."""
    deep: DeepReport
    """Overlaps of more than 1 mm, and the pairs of the other clearances."""
    observers: ObserversReport | None = None
    """Share of ticks with an observer in contact."""
    physics: PhysicsReport | None
    """Falls in the simulation, `toppled` at rest, centre of pressure, slip, torque, temperature."""
    imu: ImuReport | None = None
    """Tilt by the IMU; null without one."""
    walk: WalkTally | None = None
    """Steps of a walking robot."""
    strategies: dict[str, float] | None = None
    """Time, s, with each strategy of the hands."""
    live: LiveReport | None
    """Frames of a stream, dropped ones with reasons, lost sensors, holds; null for a file."""
    latency_ms: dict[str, TimePercentiles] | None
    """Latency from hand to shaft by stage, see `retarget.report.latency`."""
    hand_to_shaft_ms: TimePercentiles | None
    """Whole latency."""
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
    """Guesses, warnings, and omissions."""

    @property
    def lag_ms(self) -> float | None:
        """The lag of a robot, ms; None for a human alone."""
        return None if self.robot == HUMAN or self.lag_s is None else 1e3 * self.lag_s

    def as_json(self) -> str:
        """The report as JSON text; numbers that are not finite become null."""
        return json.dumps(plain(self), indent=2, allow_nan=False) + "\n"


def write_report(report: Report, path: Path) -> None:
    """Write a report, whole or not at all, and make its folder. Raises UsageError."""
    make_folder(path.parent, option="--report")
    write_atomic(path, report.as_json().encode(), option="--report")


def plain(value: Any) -> Any:
    """Data for JSON: dataclasses as objects, rounded numbers, null for non-finite ones."""
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None
    return value
