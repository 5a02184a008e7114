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

DEFAULT_FOLDER, DEFAULT_ROBOT = Path("out/demo"), "op3"


def own_folder(robot: str) -> Path:
    """The folder of the demo of a robot, by name or path: out/demo, or out/demo-NAME of another one than usual."""
    path = Path(robot).resolve()
    name = path.parent.name if path.suffix == ".yaml" else path.name
    return DEFAULT_FOLDER if robot == DEFAULT_ROBOT else DEFAULT_FOLDER.with_name(f"{DEFAULT_FOLDER.name}-{name}")


def demo(
    folder: Path | None = None,
    out: Path | None = None,
    robot: str = DEFAULT_ROBOT,
    bus: str = "emulator",
    overwrite: Overwrite = False,
) -> None:
    """See it work: a recorded performer waves, reaches and squats, and a robot follows on an emulated bus.

    Writes a report, its page, every tick and pictures into a folder; needs no data and no hardware.

    Arguments:
        folder: Where they go; usually out/demo, of another robot out/demo-NAME, where they are replaced.

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
    folder, own = folder if out is None else out, own_folder(robot)
    outputs = Outputs.in_folder(folder or own)
    if not overwrite and folder not in (None, own):
        outputs.refuse_existing("folder")

    raise typer.Exit(follow_clip(partial(open_source, "sample"), options, outputs))
