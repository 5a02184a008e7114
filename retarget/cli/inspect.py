"""`retarget inspect` describes the motion file of a performer; `retarget judge` the motion of a robot."""

import json
import math
from dataclasses import replace
from pathlib import Path

from pydantic import TypeAdapter
from rich.console import Console
from rich.table import Table
from rich.text import Text

from hardware.clock import VirtualClock
from hardware.errors import RetargetError, counted
from retarget.cli.application import FileOptions, console, given, note, refuse_given
from retarget.cli.exit import echo
from retarget.errors import UsageError
from retarget.frames import SensorFrames
from retarget.human.samples import calibration_pose
from retarget.live.address import is_address, parse_address
from retarget.model.robot import load_robot
from retarget.recording.exports.reader import read_motion
from retarget.report.judge import Judgement
from retarget.report.judge import judge as judged
from retarget.report.report import plain
from retarget.run.options import RunOptions
from retarget.schema.catalogue import HUMAN
from retarget.schema.files import check_place, write_atomic
from retarget.setup.motion_summary import MotionSummary, summarise

SHOWN_JUMPS = 8
"""Jumps that are listed; the others are counted."""


def inspect(
    source: str, file: FileOptions, mirror: bool = False, performer: str | None = None, as_json: bool = False
) -> None:
    """Say what is in a motion file or recording: frames, rate, sensors, size of the body, speeds and impossible jumps;
    and whether a run would accept a motion file, by preparing one of the virtual human.

    Arguments:
        source: A motion file of any format; 'sample', which comes with the program; or replay://FILE, a stream.

    Options:
        mirror: Left and right exchanged.
        performer NAME|FILE: The sensors of the run that is prepared, usually five.
        as_json (--json): Machine-readable, one object.
    """
    streamed = is_address(source)
    if streamed:
        refuse_given([*["--mirror"] * mirror, *["--performer"] * bool(performer)], "motion file")
    frames = _opened(source, file)
    frames = frames.mirror() if mirror else frames
    summary, pose = summarise(frames), None if streamed else calibration_pose(frames)
    if pose is not None:
        summary = replace(summary, notes=(*summary.notes, f"the recording {pose}"))
    refused = None if streamed else _refused(frames, RunOptions(robot=HUMAN, performer=performer))
    if as_json:  # what is not finite is null
        shown = json.loads(TypeAdapter(MotionSummary).dump_json(summary))
        echo(json.dumps(shown | {"refused": None if refused is None else str(refused)}, indent=2))
    else:
        show(summary, console())
    if refused is not None:
        raise refused
    if not streamed and not as_json:
        echo("a run accepts it")


def _refused(frames: SensorFrames, options: RunOptions) -> RetargetError | None:
    """The error with which a run would refuse a recording, or None."""
    from retarget.run.prepare import prepare
    from sim.mock_bus import mock_bus

    try:
        with prepare(lambda: frames, options, clock=VirtualClock(), make_bus=mock_bus):
            return None
    except RetargetError as error:
        return error


def _opened(source: str, file: FileOptions) -> SensorFrames:
    if not is_address(source) or (address := parse_address(source)).kind != "replay":
        return file.open(source)
    from retarget.live.open_stream import read_recording

    refuse_given(given(file), "motion file")
    return read_recording(address)


def show(summary: MotionSummary, console: Console) -> None:
    """Print a summary for a person."""
    console.out(summary.source)
    length = f"{counted(summary.frames, 'frame')} at {summary.rate_hz:g} Hz, {summary.duration_s:.2f} s"
    console.out(f"{length}, over {summary.travel_m:.1f} m of floor")
    if summary.stature_m is not None:
        bones = ", ".join(f"{name} {length:.3f}" for name, length in summary.lengths_m.items())
        console.out(f"body about {summary.stature_m:.2f} m tall; {bones}")
    joints = counted(len(summary.joints), "joint")
    console.out(f"whole body known: {joints}" if summary.joints else "whole body not known: sensors only")
    console.print()
    table = Table(box=None, pad_edge=False)
    table.add_column("sensor")
    for heading in ("valid", "orientation", "lowest m", "highest m", "max m/s", "jumps"):
        table.add_column(heading, justify="right")
    for sensor in summary.sensors:
        values = (sensor.lowest_m, sensor.highest_m, sensor.max_speed_m_s)
        numbers = [f"{value:.2f}" if math.isfinite(value) else "-" for value in values]
        table.add_row(sensor.name, _share(sensor.valid), _share(sensor.oriented), *numbers, str(sensor.jumps or "-"))
    console.print(table)
    _show_jumps(summary, console)
    for text in summary.notes:
        console.out(f"note: {text}")


def _share(value: float) -> str:
    """A share as text. Only exact shares are 'all' and 'none'."""
    if value in (0.0, 1.0):
        return "all" if value else "none"
    return f"{min(max(100.0 * value, 0.1), 99.9):.1f} %"


def _show_jumps(summary: MotionSummary, console: Console) -> None:
    if not summary.jumps:
        console.out("\nno jumps: nothing moves faster than a human can")
        return
    count = len({jump.frame for jump in summary.jumps})
    console.out(f"\n{counted(count, 'jump')} faster than a human can move, between a frame and the next:")
    by_frame: dict[int, list[str]] = {}
    for jump in summary.jumps:
        size = f"{jump.distance_m:.2f} m" if jump.distance_m >= 0.05 else f"{jump.turn_deg:.0f} deg"
        by_frame.setdefault(jump.frame, []).append(f"{jump.sensor} {size}")
    for frame, parts in list(by_frame.items())[:SHOWN_JUMPS]:
        more = f" and {len(parts) - 4} more" if len(parts) > 4 else ""
        console.out(f"  frame {frame + 1} ({frame / summary.rate_hz:.2f} s): {', '.join(parts[:4])}{more}")
    if count > SHOWN_JUMPS:
        console.out(f"  ... and {count - SHOWN_JUMPS} more (--json has them all)")


# The motion of a robot.

ORDERS = ("xyzw", "wxyz")


def judge(
    file: Path,
    robot: str,
    playback: FileOptions,
    source: str | None = None,
    scene: str | None = None,
    fps: float | None = None,
    quaternion: str | None = None,
    as_json: Path | None = None,
) -> None:
    """Judge the motion of a robot, from any program: limits, penetration, feet, balance, shake, whether it is frozen,
    and with --source whether it looks like the performer. Layouts and lines: docs/judge.md.

    Arguments:
        file FILE: NPZ or MCAP of a run; NPZ of mjlab, BeyondMimic, holosoma or a GMR twin; CSV of Unitree, BONES or
            `export`. No pickle is read.

    Options:
        source FILE: The performer's motion file, or 'sample', from the same moment on.
        fps N: Rows per second, of a layout that does not say them.
        quaternion xyzw|wxyz: Order of quaternions that is not that of the layout.
        as_json (--json) FILE: All figures and lines, as JSON.
    """
    if quaternion not in (None, *ORDERS):
        found = str(quaternion)[:80]
        raise UsageError("unknown order", where="--quaternion", found=found, allowed=", ".join(ORDERS))
    if as_json is not None:
        check_place(as_json, option="--json")
    body = load_robot(robot)
    layout, motion = read_motion(file, body, fps=fps, quaternion=quaternion)
    frames = None if source is None else playback.open(source)
    judgement = judged(motion, body, layout=layout, source=frames, scene=scene)
    _show_judgement(judgement)
    if as_json is not None:
        text = json.dumps(plain(judgement), indent=2, allow_nan=False) + "\n"
        write_atomic(as_json, text.encode(), option="--json")
        echo(f"json: {as_json}")


def _show_judgement(found: Judgement) -> None:
    beside = "" if found.performer is None else f" beside {found.performer}"
    of = "the run, as it followed" if found.layout == "run" else "the file, all of it"
    rows = f"{found.rows} rows at {found.rate_hz:g} Hz"
    span = f"all lines from {found.from_s:.1f} to {found.from_s + found.duration_s:.1f} s of {of}"
    echo(f"{found.file} ({found.layout}) on {found.robot}{beside}: {rows}, {span}")
    table = Table("", "", "", box=None, pad_edge=False, show_header=False)
    for line in found.lines:
        word = {True: "kept", False: "LOST", None: ""}[line.kept]
        broken = f" [allowed: {line.allowed}]" if line.allowed and line.kept is False else ""
        table.add_row(word, line.name, Text(line.measured + broken))
    console().print(table)
    echo(found.verdict)
    for text in found.notes:
        note(text)
