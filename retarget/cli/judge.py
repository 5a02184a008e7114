"""`retarget judge FILE --robot R`: a neutral referee of robot motion from any program."""

import json
from pathlib import Path

from rich.table import Table
from rich.text import Text

from retarget.cli.application import FileOptions, console, note
from retarget.cli.exit import echo
from retarget.errors import UsageError
from retarget.model.robot import load_robot
from retarget.recording.exports.reader import read_motion
from retarget.report.judge import Judgement
from retarget.report.judge import judge as judged
from retarget.report.report import plain
from retarget.schema.files import check_place, write_atomic

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
        robot NAME|PATH: Robot by name or path.
        source FILE: The performer's motion file, or 'sample', from the same moment on.
        scene NAME|FILE: The scene: table, wall, ..., or a file.
        fps N: Rows per second, of a layout that does not say them.
        quaternion xyzw|wxyz: Of a file that is not as its layout has it.
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
    show(judgement)
    if as_json is not None:
        text = json.dumps(plain(judgement), indent=2, allow_nan=False) + "\n"
        write_atomic(as_json, text.encode(), option="--json")
        echo(f"json: {as_json}")


def show(found: Judgement) -> None:
    """Print the table, and the verdict below it."""
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
