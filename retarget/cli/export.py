"""`retarget export FILE --to FORMAT`: a recorded run for other tools."""

from pathlib import Path

import numpy as np

from hardware.errors import counted
from retarget.cli.application import note
from retarget.cli.exit import echo
from retarget.errors import UsageError
from retarget.recording.exports.formats import (
    export_episodes,
    export_motion,
    export_place,
    format_help,
    format_named,
)
from retarget.recording.exports.lerobot_dataset import DEFAULT_TASK
from retarget.recording.motion import Motion, followed, resampled
from retarget.recording.read_run import read_run
from retarget.run.record import PHASE_NAMES, Phase

LEROBOT = "lerobot"
FOLLOW, ALL = "follow", "all"
ROBOT, HUMAN = "robot", "human"


def export(
    files: list[Path],
    to: str,
    out: Path | None = None,
    fps: float | None = None,
    phase: str = FOLLOW,
    of: str = ROBOT,
    body: Path | None = None,
    task: str = DEFAULT_TASK,
    overwrite: bool = False,
) -> None:
    """Export a recorded run: joint positions with names and units, in a format that others read.

    parquet and lerobot need the extra 'record'. Quaternions, joints, root and units are printed: docs/results.md.

    Arguments:
        files FILE...: A run that was saved or recorded: FILE.npz, FILE.mcap; several are the episodes of one LeRobot
            dataset.

    Options:
        to FORMAT: {formats}
        out PATH: Path of the export, usually beside FILE.
        fps N: Resample to so many rows per second; else as the readers of the format expect, or rows are the ticks.
        phase follow|all: Part of the run: 'all' includes the approach and the braking.
        of robot|human: Motion of the robot, or of the human that it followed.
        task: Task in words, for a LeRobot dataset.
    """
    form = format_named(to)
    for option, value, allowed in (("--phase", phase, (FOLLOW, ALL)), ("--of", of, (ROBOT, HUMAN))):
        if value not in allowed:
            raise UsageError("unknown choice", where=option, found=value[:80], allowed=", ".join(allowed))
    if len(files) > 1 and form.name != LEROBOT:
        found, step = f"{len(files)} files", f"Export them one by one, or --to {LEROBOT}"
        raise UsageError("only a LeRobot dataset holds several runs", where="--to", found=found, next_step=step)
    inputs = files[1:] if body is None else [*files[1:], body]
    wholes = [read_run(file, of_human=of == HUMAN, body=body) for file in files]
    for text in dict.fromkeys(text for whole in wholes for text in whole.notes):
        note(text)
    place = export_place(form, files[0], out, of_human=of == HUMAN, inputs=inputs)
    fps = form.conventions.fps if fps is None else fps
    step = "Export all of it: --phase all"
    chosen = wholes if phase == ALL else [followed(whole, next_step=step) for whole in wholes]
    motions = chosen if fps is None else [resampled(motion, fps) for motion in chosen]
    if len(motions) > 1:
        export_episodes(motions, place, task=task, overwrite=overwrite)
    else:
        export_motion(motions[0], form, place, task=task, overwrite=overwrite)
    echo(f"{to}: {place}")
    for whole, before, motion in zip(wholes, chosen, motions, strict=True):
        echo(_summary(whole, motion, phase, None if motion is before else fps))
    echo(str(form.conventions))


export.__doc__ = str(export.__doc__).replace("{formats}", format_help())


def _summary(whole: Motion, motion: Motion, phase: str, fps: float | None) -> str:
    text = counted(len(motion), "row")
    text += f" at {fps:g} Hz, resampled" if fps is not None else f", one for each {motion.row}"
    text += f", {motion.time[-1] - motion.time[0]:.2f} s"
    if phase == ALL:
        return text
    counts = np.bincount(whole.phase, minlength=len(Phase)).tolist()
    others = [(PHASE_NAMES[phase], counts[phase]) for phase in Phase if phase is not Phase.FOLLOW]
    left = " and ".join(f"{counted(count, 'row')} of {name}" for name, count in others if count)
    return f"{text}; left out: {left} (--phase all has them)" if left else text
