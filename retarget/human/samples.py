"""Sensor samples for the ticks of a run: of a recorded clip laid on these ticks, or of a live stream."""

from dataclasses import dataclass, field, replace
from itertools import compress
from typing import ClassVar, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from hardware.errors import counted
from retarget.arithmetic import norms
from retarget.errors import InputError, UsageError
from retarget.frames import SensorFrames, SensorSample, on_grid
from retarget.human.pose_validation import without_jumps
from retarget.human.rest_pose import ALIKE_RAD, fit_rest_pose, rest_pose_name
from retarget.human.sensor_intake import IntakeTimes, without_spikes
from retarget.model.human_dimensions import HumanDimensions
from retarget.schema.performer import Performer
from retarget.types import BoolArray, FloatArray


class Performing(Protocol):
    """A performer as a tick sees it."""

    @property
    def paused(self) -> bool:
        """True while the operator pauses the robot."""

    def may_approach(self) -> bool:
        """True if the robot is to go on with its approach. Called in every tick of it."""

    def sample(self, tick: int) -> SensorSample | None:
        """The sensors at a tick; None, but never at tick 0, if the robot is to hold."""

    @property
    def hold_reason(self) -> str:
        """Reason, in a few words, of the last hold."""


class Samples(Performing, Protocol):
    """Sensors for each tick."""

    @property
    def ticks(self) -> int:
        """Most ticks that are followed."""

    @property
    def kept(self) -> int:
        """Number of recorded ticks."""

    @property
    def dt(self) -> float:
        """Seconds between ticks."""

    @property
    def motion_dt(self) -> float:
        """Seconds of the performer's time between ticks."""

    @property
    def over(self) -> bool:
        """True if the performance has ended before its last tick."""

    def poll(self) -> None:
        """Take in the stream's data, also during a hold."""

    def hold(self) -> None:
        """Hold though the sensors are valid."""

    def recorded(self) -> "Clip":
        """The samples of the followed ticks, for reports and recordings."""


@dataclass(frozen=True, eq=False)
class PerformerInput:
    """The performer at a tick. tick: of the performance, None before it begins. sample: None for a hold.

    may_go_on: True if the robot may follow or go on with its approach; else hold_reason.
    """

    tick: int | None = None
    sample: SensorSample | None = None
    may_go_on: bool = False
    hold_reason: str = ""
    paused: bool = False
    over: bool = False


@dataclass(frozen=True, eq=False)
class Performance:
    """A performer: samples, size, notes for the operator, and intake times."""

    samples: Samples
    dimensions: HumanDimensions
    notes: tuple[str, ...] = ()
    intake: IntakeTimes = field(default_factory=IntakeTimes)


Parts = Literal["whole", "upper"]

LOOP_LIMIT_S = 600.0  # a loop ends by itself, s of the run
SEAM_S = 1.0  # of the performer's time, from the last frame of a loop to its first
MAX_KEPT = 80_000
"""Most ticks that are kept for the report, 10 minutes at 125 Hz. With 20 servos a row and its sample take 3.3 KB."""
SPEEDS = (0.01, 10.0)  # of `--speed`, times the recorded one
RATES_HZ = (1.0, 2000.0)  # [Hz] of `--rate`; values beyond these limits are mistyped


@dataclass(frozen=True)
class Playback:
    """Settings of a playback. speed: 1 is the performer's. start, end: s of the recording, both included."""

    speed: float = 1.0
    start: float | None = None
    end: float | None = None
    loop: bool = False
    mirror: bool = False
    keep_calibration_frame: bool = False

    def __post_init__(self) -> None:
        low, high = SPEEDS
        if not low <= self.speed <= high:
            raise UsageError(
                "impossible speed", where="--speed", found=f"{self.speed:g}", allowed=f"{low:g} to {high:g}"
            )
        for option, time in (("--start", self.start), ("--end", self.end)):
            if time is not None and not 0.0 <= time < float("inf"):
                raise UsageError("no time of a recording", where=option, found=f"{time:g} s", allowed="0 or later")
        if self.end is not None and (self.start or 0.0) >= self.end:
            options, found = (
                "--end" if self.start is None else "--start, --end",
                f"{self.start or 0.0:g} to {self.end:g} s",
            )
            raise UsageError("the end is not after the start", where=options, found=found)


@dataclass(frozen=True, eq=False)
class Clip:
    """A motion on ticks. frames: row i is the sample of tick i, on the run's clock.

    ticks: of the run, more than the rows of a loop or of a long run. source_frames: number of played frames. lap: ticks
    until a loop begins again. beyond: the recording, on the performer's time, for ticks without a row. with_jumps: the
    clip before jumps were taken out, if it had any.
    """

    frames: SensorFrames
    ticks: int
    rate_hz: float
    speed: float
    source_frames: int
    left_out: "CalibrationPose | None" = field(default=None, kw_only=True)
    lap: int = field(default=0, kw_only=True)
    beyond: SensorFrames | None = field(default=None, kw_only=True)
    with_jumps: "Clip | None" = field(default=None, kw_only=True)
    paused: ClassVar[bool] = False
    hold_reason: ClassVar[str] = ""

    def __len__(self) -> int:
        return self.ticks

    @property
    def dt(self) -> float:
        """Seconds between ticks."""
        return 1.0 / self.rate_hz

    @property
    def motion_dt(self) -> float:
        """Seconds of the performer's time between ticks."""
        return self.speed / self.rate_hz

    @property
    def kept(self) -> int:
        """The first `MAX_KEPT` ticks."""
        return min(self.ticks, MAX_KEPT)

    @property
    def over(self) -> bool:
        """False: a clip ends with its last tick."""
        return False

    def may_approach(self) -> bool:
        """True: a clip waits."""
        return True

    def poll(self) -> None:
        """Do nothing."""

    def hold(self) -> None:
        """Do nothing."""

    def sample(self, tick: int) -> SensorSample:
        """The sensors at a tick, on the grid."""
        frames, row = self.frames, tick % (self.lap or len(self.frames))
        if row >= len(frames):
            assert self.beyond is not None, "every tick has a row, or is of the recording"
            return on_grid(self.beyond.sample(row * self.motion_dt))
        return on_grid(SensorSample(frames.names, frames.position[row], frames.orientation[row], frames.valid[row]))

    def jumped(self, tick: int) -> BoolArray:
        """Mask (k,) of the sensors that are taken out at a tick."""
        whole, sane = self.with_jumps, self.sample(tick).valid
        return np.zeros_like(sane) if whole is None else whole.sample(tick).valid & ~sane

    @property
    def names_of_jumped(self) -> tuple[str, ...]:
        """Sensors that were ever taken out."""
        if self.with_jumps is None:
            return ()
        parts = [(self.with_jumps.frames, self.frames), (self.with_jumps.beyond, self.beyond)]
        lost = [
            (whole.valid & ~sane.valid).any(axis=0) for whole, sane in parts if whole is not None and sane is not None
        ]
        return tuple(compress(self.frames.names, np.any(lost, axis=0).tolist()))

    def recorded(self) -> "Clip":
        """The clip itself."""
        return self

    def frames_played(self, ticks: int) -> int:
        """Number of recorded frames in the first ticks, by lap."""
        return round(self.source_frames * ticks / (self.lap or len(self.frames)))

    def rows(self, ticks: int) -> NDArray[np.int64]:
        """Rows (ticks,) of `frames` in the first ticks."""
        return np.arange(ticks, dtype=np.int64) % len(self.frames)

    def truth(self, names: tuple[str, ...], ticks: range) -> FloatArray | None:
        """Recorded joint centres (T, m, 3), NaN for unknown ones, or None."""
        tracks = self.frames.joints
        if tracks is None:
            return None
        columns = [tracks.names.index(name) if name in tracks.names else -1 for name in names]
        known = np.array([column >= 0 for column in columns])
        if not known.any():
            return None
        at = np.arange(ticks.start, ticks.stop, dtype=np.int64) % len(self.frames)
        track = tracks.position[at[:, None], columns]
        track[:, ~known] = np.nan
        return np.asarray(track)


def lay_on_ticks(
    frames: SensorFrames, *, performer: Performer, playback: Playback, rate_hz: float | None = None
) -> Clip:
    """Interpolate a recording onto ticks, by default at its own rate.

    Raises UsageError: a sensor is missing, the cut is empty, or the rate or length is impossible.
    """
    start, pose = playback.start, None
    if start is None and not playback.keep_calibration_frame:
        pose = calibration_pose(frames)
    if pose is not None:
        start = float(frames.time[pose.frames])
        if playback.end is not None and playback.end < start:
            raise UsageError(
                "only a calibration pose comes before the end",
                where="--end",
                found=f"{playback.end:g} s",
                allowed=f"{start:.3f} s, where the motion begins, or later",
                next_step="To play the pose too, add --keep-calibration-frame",
            )
    missing = [name for name in performer.sensors if name not in frames.names]
    if missing:
        raise UsageError(
            f"the source does not have all sensors of performer {performer.name!r}",
            where=frames.source,
            found=f"no {', '.join(missing)}",
            allowed=", ".join(frames.names),
            next_step="Choose another --performer",
        )
    frames = frames.select(tuple(performer.sensors)).cut(start, playback.end)
    frames = replace(frames, position=without_spikes(frames.time, frames.position))
    if playback.mirror:
        frames = frames.mirror().select(tuple(performer.sensors))
    rate = frames.rate_hz if rate_hz is None else rate_hz
    if not RATES_HZ[0] <= rate <= RATES_HZ[1]:
        allowed = f"{RATES_HZ[0]:g} to {RATES_HZ[1]:g} Hz"
        raise UsageError("impossible rate of ticks", where="--rate", found=f"{rate:g} Hz", allowed=allowed)
    sane = without_jumps(frames)
    clip = _laid(sane, playback, rate, pose)
    return clip if sane is frames else replace(clip, with_jumps=_laid(frames, playback, rate, pose))


def _laid(frames: SensorFrames, playback: Playback, rate: float, pose: "CalibrationPose | None") -> Clip:
    step = playback.speed / rate  # [s] of the performer's time
    played = frames
    if playback.loop:  # straight back to the beginning, in a whole number of ticks
        end = _count(frames.duration_s + SEAM_S, step) * step
        played = frames.at_rows([*range(len(frames)), 0], np.append(frames.time, end))
    lap = _count(played.duration_s, step) - playback.loop  # the last tick of a loop is its first one again
    ticks = round(LOOP_LIMIT_S * rate) if playback.loop else lap
    laid = played.resample(np.arange(min(lap, MAX_KEPT)) * step)
    laid = replace(laid, time=np.arange(len(laid)) / rate, rate_hz=rate)
    beyond = replace(played, joints=None) if len(laid) < lap else None
    return Clip(laid, max(ticks, 1), rate, playback.speed, len(frames), left_out=pose, lap=lap, beyond=beyond)


CALIBRATION_JUMP, CALIBRATION_JUMP_M = 5.0, 0.05
"""A calibration pose ends where a sensor jumps by this many times its usual step, plus m."""
CALIBRATION_FRAMES, MOTION_S = 6, 0.25  # frames of a calibration pose, and s of the motion after it that count


@dataclass(frozen=True)
class CalibrationPose:
    """A calibration pose before a recorded motion: T, A or N."""

    name: str
    frames: int

    def __str__(self) -> str:
        frames = counted(self.frames, "frame")
        return f"begins with a calibration pose ({self.name}, {frames}): left out without --keep-calibration-frame"


def calibration_pose(frames: SensorFrames) -> CalibrationPose | None:
    """The calibration pose with which a recording begins; None without one."""
    looked_at = CALIBRATION_FRAMES + max(round(MOTION_S * frames.rate_hz), 3)
    seen = np.asarray(frames.valid[: looked_at + 1].all(axis=0))
    if len(frames) <= looked_at or not seen.any():
        return None
    steps = norms(np.diff(frames.position[: looked_at + 1, seen], axis=0)).max(axis=1)
    jumps = steps > CALIBRATION_JUMP * np.median(steps) + CALIBRATION_JUMP_M
    count = int(np.argmin(jumps))  # of leading jumps
    if not 0 < count <= CALIBRATION_FRAMES:
        return None
    names = tuple(name for name, ok in zip(frames.names, seen, strict=True) if ok)
    try:
        left, right = fit_rest_pose(names, frames.position[0, seen]).arms.tolist()
    except InputError:
        return None
    return CalibrationPose(rest_pose_name(0.5 * (left + right)), count) if abs(left - right) <= ALIKE_RAD else None


def _count(duration: float, step: float) -> int:
    return int(np.floor(duration / step + 1e-6)) + 1
