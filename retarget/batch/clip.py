"""One clip of a data set: a motion file in, one output and a row out. Clips are independent, so that any engine may run
any clip anywhere."""

import hashlib
import importlib
import json
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from enum import StrEnum
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np

import retarget
from hardware.bus import ServoBus
from hardware.clock import Clock, MonotonicClock, VirtualClock
from hardware.errors import RetargetError
from hardware.guard_state import StopCause
from retarget.errors import InputError
from retarget.human.samples import Samples
from retarget.model.body_file import Root
from retarget.model.robot import RobotBody, load_robot
from retarget.recording.exports.formats import export_motion, format_named
from retarget.recording.motion import followed, resampled
from retarget.recording.npz import human_body_path, write_npz
from retarget.recording.read_run import motion_of
from retarget.recording.session import config_files
from retarget.report.findings import findings
from retarget.report.measure import measure
from retarget.report.motion_metrics import moved_joints
from retarget.report.report import DIGITS
from retarget.run.loop import Operator
from retarget.run.options import RunOptions
from retarget.run.prepare import performance_of, prepare_for
from retarget.run.run_result import RunResult
from retarget.run.supervisor import OperatorInput
from retarget.run.tick import Machine
from retarget.sources.asf_amc import find_skeleton
from retarget.sources.open import open_source
from retarget.types import Notify, RunState

RUN = "run"
"""Format of `--save`, the whole run. All other formats are those of `retarget export`."""
LONGEST_TEXT = 500
"""Longest text in a row, characters."""


class ClipStatus(StrEnum):
    """The end of a clip."""

    DONE = "done"
    STOPPED = "stopped"
    """The guard ended the run early, and the output ends early."""
    REFUSED = "refused"
    """The file cannot be read, or the motion cannot be followed."""
    FAILED = "failed"
    """There was an unforeseen error."""
    TIMED_OUT = "timed out"
    CRASHED = "crashed"
    """The process ended."""
    OUT_OF_MEMORY = "out of memory"

    @property
    def has_output(self) -> bool:
        """True if a clip of this status has an output."""
        return self in (ClipStatus.DONE, ClipStatus.STOPPED)


@dataclass(frozen=True, slots=True)
class BatchClip:
    """A clip. source: absolute path of the motion file. output: path below the folder of outputs, POSIX."""

    source: str
    output: str


@dataclass(frozen=True)
class BatchSettings:
    """Settings of a batch. out: absolute path of the outputs. reading: options of `open_source`. fps: of the outputs,
    None for a row per tick. bench: importable name (`module:attribute`) of a `MakeBench`. hash: SHA-256 of all inputs
    of an output except its source."""

    out: Path
    options: RunOptions
    reading: tuple[tuple[str, Any], ...]
    format: str
    fps: float | None
    bench: str
    hash: str


class ClipBench(Protocol):
    """Simulated hardware of the run of one clip."""

    def make_bus(self, robot: RobotBody, clock: Clock) -> ServoBus:
        """Make the bus of the run."""

    def look(self, machine: Machine, samples: Samples) -> tuple[StopCause, str] | None:
        """Check the simulation once a tick. Returns the reason for a stop, if there is one."""

    def seen(self, run: RunResult) -> RunResult:
        """Add the measurements of the simulation to a finished run."""


MakeBench = Callable[[RunOptions, Notify], ClipBench]


@dataclass(frozen=True, kw_only=True)
class ClipRow:
    """The row of a clip. Unknown numbers are None.

    error: class of the error. verdict, differs: as `retarget run` prints them. stop: reason of the guard. frames: of
    the source; seconds: of following; took_s: wall time. tracking_mm, tracking_max_mm: of landmarks; likeness_deg,
    likeness_worst_deg: of limbs. penetrating_ticks: with contact of the body with itself or the scene; clearance_mm: to
    itself. at_position_limit, at_velocity_limit, at_acceleration_limit, gated: shares of the ticks that followed.
    source_bytes, source_time_ns: size and modification time of the source.
    """

    source: str
    output: str
    status: ClipStatus
    format: str = ""
    error: str = ""
    message: str = ""
    verdict: str = ""
    differs: str = ""
    stop: str = ""
    notes: str = ""
    frames: int | None = None
    ticks: int | None = None
    seconds: float | None = None
    took_s: float | None = None
    tracking_mm: float | None = None
    tracking_max_mm: float | None = None
    likeness_deg: float | None = None
    likeness_worst_deg: float | None = None
    foot_slide_mm: float | None = None
    penetrating_ticks: int | None = None
    clearance_mm: float | None = None
    at_position_limit: float | None = None
    at_velocity_limit: float | None = None
    at_acceleration_limit: float | None = None
    gated: float | None = None
    fallen: bool | None = None
    source_hash: str = ""
    source_bytes: int = 0
    source_time_ns: int = 0
    settings_hash: str = ""

    def as_json(self) -> str:
        """The row as a line of JSON. Numbers are rounded as in a report, and null if they are not finite."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        for name, value in values.items():
            if isinstance(value, float):
                values[name] = float(f"{value:.{DIGITS}g}") if np.isfinite(value) else None
        return json.dumps(values, allow_nan=False)


# Hashes, by which finished clips are recognised.


@dataclass(frozen=True, slots=True)
class SourceState:
    """Total size and latest modification time, ns, of the files of a source; -1 if one is missing."""

    bytes: int
    time_ns: int


def files_of(source: Path, reading: Mapping[str, Any]) -> list[Path]:
    """The files of a motion: its own, the skeleton of an AMC, the table of a C3D's markers."""
    beside = [Path(reading[option]) for option in ("skeleton", "markers") if reading.get(option) is not None]
    if source.suffix.lower() == ".amc" and reading.get("skeleton") is None:
        with suppress(InputError, OSError):  # the reader reports it
            beside.append(find_skeleton(source))
    return [source, *beside]


def source_state(source: Path, reading: Mapping[str, Any]) -> SourceState:
    """The state of the files of a source."""
    try:
        found = [path.stat() for path in files_of(source, reading)]
    except OSError:
        return SourceState(-1, -1)
    return SourceState(sum(one.st_size for one in found), max(one.st_mtime_ns for one in found))


def source_hash(source: Path, reading: Mapping[str, Any]) -> str:
    """The SHA-256 of the files of a source, "" if one cannot be read."""
    whole = hashlib.sha256()
    try:
        for path in files_of(source, reading):
            if not path.is_file():  # a pipe might block forever
                return ""
            with path.open("rb") as stream:
                whole.update(hashlib.file_digest(stream, "sha256").digest())
    except OSError:
        return ""
    return whole.hexdigest()


def batch_settings(
    out: Path,
    options: RunOptions,
    *,
    bench: str,
    reading: Mapping[str, Any] | None = None,
    form: str = RUN,
    fps: float | None = None,
) -> BatchSettings:
    """The settings of a batch. Their hash covers the version, all options, and the files of profile, body,
    calibration, priorities, performer and scene. form: the format. Raises RetargetError."""
    if form != RUN:
        fps = format_named(form).conventions.fps if fps is None else fps
    robot = None if options.is_human else load_robot(options.robot, root=options.root)
    reading = {name: value for name, value in (reading or {}).items() if value is not None}
    about = {
        "version": retarget.__version__,
        "options": asdict(options),
        "files": [(file.name, file.sha256) for file, _ in config_files(options, robot)],
        "reading": reading,
        "format": form,
        "fps": fps,
        "bench": bench,
    }
    text = json.dumps(about, sort_keys=True, default=str)
    digest = hashlib.sha256(text.encode(errors="surrogateescape")).hexdigest()
    return BatchSettings(out.absolute(), options, tuple(sorted(reading.items())), form, fps, bench, digest)


# From a clip to its row.

Follow = Callable[[BatchClip, BatchSettings], ClipRow]
"""Run one clip and write its output, like `follow_clip`. May raise anything."""


def process_clip(clip: BatchClip, settings: BatchSettings, follow: Follow | None = None) -> ClipRow:
    """Retarget one clip. Every error becomes a row. follow: in place of `follow_clip`."""
    clock = MonotonicClock()
    begun = clock.now()
    try:
        row = (follow or follow_clip)(clip, settings)
    except MemoryError as error:
        row = failed_row(clip, settings, ClipStatus.OUT_OF_MEMORY, type(error).__name__, str(error) or "no memory")
    except RetargetError as error:
        row = failed_row(clip, settings, ClipStatus.REFUSED, type(error).__name__, str(error))
    except Exception as error:  # noqa: BLE001 - it does not affect the other clips
        last = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{error} ({Path(last.filename).name}:{last.lineno}, {last.name})"
        row = failed_row(clip, settings, ClipStatus.FAILED, type(error).__name__, text)
    return replace(row, took_s=clock.now() - begun)


def failed_row(clip: BatchClip, settings: BatchSettings, status: ClipStatus, error: str, message: str) -> ClipRow:
    """The row of a clip without an output."""
    return _row(clip, settings, status, error=error, message=message)


def _row(clip: BatchClip, settings: BatchSettings, status: ClipStatus, **known: Any) -> ClipRow:
    source, reading = Path(clip.source), dict(settings.reading)
    state = source_state(source, reading)
    for name, value in known.items():
        if isinstance(value, str):
            known[name] = " ".join(value.split())[:LONGEST_TEXT]
    return ClipRow(
        source=clip.source,
        output=clip.output,
        status=status,
        format=settings.format,
        source_hash=source_hash(source, reading),
        source_bytes=state.bytes,
        source_time_ns=state.time_ns,
        settings_hash=settings.hash,
        **known,
    )


def follow_clip(clip: BatchClip, settings: BatchSettings) -> ClipRow:
    """Follow a clip in virtual time, write the output, and measure the run. Raises RetargetError."""
    options, frames_of = settings.options, lambda: open_source(Path(clip.source), **dict(settings.reading))
    make_bench: MakeBench = importable(settings.bench)
    bench = make_bench(options, lambda text: None)
    perform, robot = performance_of(frames_of, options.playback), None
    if not options.is_human:
        robot = _robot(options.robot, options.root)
    with prepare_for(perform, options, clock=VirtualClock(), make_bus=bench.make_bus, robot=robot) as prepared:
        result = prepared.run(_BenchOperator(bench, prepared.machine, prepared.samples))
    result = bench.seen(result)
    _write(result, clip, settings)
    return _measured(result, clip, settings)


def importable(name: str) -> Any:
    """The object of an importable name, `module:attribute`."""
    module, _, attribute = name.partition(":")
    return getattr(importlib.import_module(module), attribute)


@lru_cache(maxsize=1)
def _robot(name: str, root: Root | None) -> RobotBody:
    """The robot of all clips of a process, so that its body is measured once."""
    return load_robot(name, root=root)


class _BenchOperator(Operator):
    def __init__(self, bench: ClipBench, machine: Machine | None, samples: Samples) -> None:
        self._bench, self._machine, self._samples = bench, machine, samples

    def poll(self, state: RunState | None) -> OperatorInput:
        if self._machine is None:
            return OperatorInput()
        return OperatorInput(fault=self._bench.look(self._machine, self._samples))


def places_of(clip: BatchClip, settings: BatchSettings) -> list[Path]:
    """The output files of a clip: one, and for a whole run of the virtual human its body beside it."""
    place = settings.out / clip.output
    with_body = settings.options.is_human and settings.format == RUN
    return [place, human_body_path(place)] if with_body else [place]


def _write(run: RunResult, clip: BatchClip, settings: BatchSettings) -> None:
    place = settings.out / clip.output
    place.parent.mkdir(parents=True, exist_ok=True)
    if settings.format == RUN:
        write_npz(run, place)
        return
    motion = followed(motion_of(run, clip.source), found=run.reason or "no such tick")
    if settings.fps is not None:
        motion = resampled(motion, settings.fps)
    # The index has checked that an existing file was made of this source.
    export_motion(motion, format_named(settings.format), place, overwrite=True)


def _measured(run: RunResult, clip: BatchClip, settings: BatchSettings) -> ClipRow:
    report = measure(run)
    following = next((one.measured for one in findings(run, report) if one.name == "following"), "")
    verdict, _, differs = following.partition(": ")
    tracking = report.tracking_mm.values()
    limbs = [one.mean for one in (report.likeness_recorded_deg or report.likeness_deg or {}).values()]
    gated = run.record.gated[run.record.following]
    return _row(
        clip,
        settings,
        ClipStatus.DONE if run.reason is None else ClipStatus.STOPPED,
        verdict=verdict,
        differs=differs,
        stop=run.reason or "",
        notes="; ".join(run.notes),
        frames=report.frames,
        ticks=report.ticks,
        seconds=run.ticks_followed * run.clip.dt,
        tracking_mm=_mean([one.mean for one in tracking]),
        tracking_max_mm=max((one.max for one in tracking), default=None),
        likeness_deg=_mean(limbs),
        likeness_worst_deg=max(limbs, default=None),
        foot_slide_mm=report.foot_slide_mm,
        penetrating_ticks=report.penetrating_frames,
        clearance_mm=report.min_clearance_mm.self,
        gated=None if run.robot is None or not gated.size else float(gated.mean()),
        fallen=report.fallen,
        **limit_shares(run),
    )


AT_LIMIT = 0.999
"""Share of its greatest speed or acceleration from which on a joint is at the limit."""
AT_POSITION = 1e-4
"""Distance from its limit within which a joint is at it, rad or m."""


def limit_shares(run: RunResult) -> dict[str, float]:
    """The shares of the ticks that followed in which at least one joint is at its limit, by the fields of a row;
    {} if fewer than three ticks followed."""
    moved = moved_joints(run)
    q, limits, dt = moved.positions[run.record.following], moved.limits, moved.dt
    if len(q) < 3 or not moved.names:
        return {}
    step = np.diff(q, axis=0)
    at = {
        "position": (q < limits.lower + AT_POSITION) | (q > limits.upper - AT_POSITION),
        "velocity": np.abs(step) >= AT_LIMIT * dt * limits.max_velocity,
        "acceleration": np.abs(np.diff(step, axis=0)) >= AT_LIMIT * dt**2 * limits.max_acceleration,
    }
    return {f"at_{kind}_limit": float(flags.any(axis=1).mean()) for kind, flags in at.items()}


def _mean(values: list[float]) -> float | None:
    return float(np.mean(values)) if values else None
