"""The report of a run that somebody ended and now waits for: what costs much is measured on its last seconds only."""

from dataclasses import replace

import numpy as np

from retarget.clip import Clip
from retarget.frames import JointTracks
from retarget.metrics.bus import bus_report
from retarget.metrics.measure import limits_broken, measure
from retarget.report import Report
from retarget.run_result import RunResult

__all__ = ["LATEST_S", "latest_of", "measure_latest"]

LATEST_S = 10.0
"""Of so long a run distances are measured within 0.4 s on a slow core."""


def measure_latest(run: RunResult, seconds: float = LATEST_S) -> Report:
    """As `measure`, of its last `seconds`; ticks, duration, limits and the bus are those of the whole run."""
    latest = latest_of(run, seconds)
    if latest is run:
        return measure(run)
    note = f"told of the last {seconds:g} s, but for ticks, limits and the end; --report measures the whole run"
    report = measure(latest)
    return replace(
        report,
        frames=min(run.clip.frames_played(run.ticks_followed), run.clip.source_frames),
        ticks=len(run.record),
        limit_violations=limits_broken(run),
        bus=bus_report(run),
        notes=(*report.notes, note),
    )


def latest_of(run: RunResult, seconds: float) -> RunResult:
    """The last `seconds` of a run; itself where it is no longer, and where it was simulated, as a whole."""
    record, clip = run.record, run.clip
    first = len(record) - round(seconds / clip.dt)
    if first <= 0 or run.physics is not None:
        return run
    following = record.following
    begun = max(first - following.start, 0)
    kept = record.rows(first, len(record))
    if record.robot is not None and kept.robot is not None:
        kept = replace(kept, robot=replace(kept.robot, start=record.robot.goals[first - 1].copy()))
    return replace(run, record=replace(kept, from_start=False), clip=_from(clip, begun, run.ticks_followed))


def _from(clip: Clip, first: int, end: int) -> Clip:
    """The ticks of a clip from `first` to before `end`; at least one."""
    frames, rows = clip.frames, clip.rows(max(end, first + 1))[first:]
    joints = frames.joints
    shown = replace(
        frames,
        time=np.arange(len(rows)) / clip.rate_hz,
        position=frames.position[rows],
        orientation=frames.orientation[rows],
        valid=frames.valid[rows],
        joints=None if joints is None else JointTracks(joints.names, joints.position[rows]),
    )
    return Clip(shown, len(rows), clip.rate_hz, clip.speed, len(rows))
