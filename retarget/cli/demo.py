"""`retarget demo`: the recorded performer that comes with the program drives a robot on a simulated bus. No data, no
hardware."""

from functools import partial
from pathlib import Path

import typer

from retarget.cli.application import Overwrite
from retarget.cli.run import follow_clip
from retarget.errors import UsageError
from retarget.pictures.outputs import Outputs
from retarget.run.options import SIMULATED, RunOptions
from retarget.sources.open import open_source

DEFAULT_FOLDER = Path("out/demo")


def demo(
    folder: Path = DEFAULT_FOLDER,
    out: Path | None = None,
    robot: str = "op3",
    bus: str = "emulator",
    overwrite: Overwrite = False,
) -> None:
    """See it work: a recorded performer waves, reaches and squats, and a robot follows on an emulated bus.

    Writes a report, its page, every tick and pictures into a folder (out/demo is its own: there they are replaced);
    needs no data and no hardware.

    Arguments:
        folder: Where report, recording and pictures go.

    Options:
        out DIR: The same.
        robot NAME|PATH: Robot by name or path.
        bus mock|emulator|physics|physics+wire|none: Where goals go, as of `run`.
    """
    options = RunOptions(robot=robot, bus=bus)
    if not options.simulated:
        raise UsageError(
            "a demo moves no real servos",
            where="--bus",
            found=bus,
            allowed=", ".join(SIMULATED),
            next_step="See `retarget run`",
        )
    folder = folder if out is None else out
    outputs = Outputs.in_folder(folder)
    if not overwrite and folder != DEFAULT_FOLDER:
        outputs.refuse_existing("folder")

    raise typer.Exit(follow_clip(partial(open_source, "sample"), options, outputs))
