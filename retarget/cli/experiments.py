"""`retarget experiments`: the paper's experiments and figures, run anew."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from hardware.clock import MonotonicClock
from retarget.cli.overwrite import Overwrite
from retarget.cli.progress import progress_bar
from retarget.errors import UsageError, suggest
from retarget.experiments.made_motion import made_jog, made_jump
from retarget.experiments.run import NAMES, Motions, Results, run_experiments
from retarget.experiments.table import as_table
from retarget.experiments.trials import CROUCH, JOG, JUMP, read_trial
from retarget.outputs import check_folder, make_folder, refuse_existing, write_atomic

DEFAULT_FOLDER = Path("out/experiments")
RUNS = 8
"""Reconstructions of the crouching motion: two free ones, and three experiments with two configurations."""


PIPED_WIDTH = 120
"""Columns of the table where no terminal says how many there are."""


def experiments(
    mocap: Annotated[
        Path | None,
        typer.Option(
            help="Folder of recordings, searched for CMU 02_06, 02_03 and 02_04; without: synthetic motion.",
            metavar="DIR",
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Where pictures and numbers go.", metavar="DIR")] = DEFAULT_FOLDER,
    only: Annotated[str | None, typer.Option(help=f"Some of {', '.join(NAMES)}.", metavar="NAME,...")] = None,
    n_ik: Annotated[
        int | None,
        typer.Option("--n-ik", min=1, max=100, help="Iterations per frame at most (the paper's: 5).", metavar="N"),
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Repeat the paper's experiments: pictures like its figures, and a table beside its numbers.

    Experiments 1 to 3 run with the paper's priorities and line observers, and with ours and capsules. Obstacles are
    placed from the motion.
    """
    names = _chosen(only)
    check_folder(out, option="--out")
    path = out / "experiments.json"
    if not overwrite and out != DEFAULT_FOLDER:
        refuse_existing(path, option="--out")
    motions = _motions(mocap)
    make_folder(out, option="--out")
    total = RUNS * len(motions.crouch)
    with progress_bar("experiments", total if "crouching" in names else 1) as show:
        results = run_experiments(
            motions,
            out,
            clock=MonotonicClock(),
            only=names,
            iterations=n_ik,
            progress=_Counter(show, len(motions.crouch)),
        )
    write_atomic(path, json.dumps(results.data, indent=2, allow_nan=False).encode(), option="--out")
    _show(results, path)


class _Counter:
    """Frames of several runs, one after the other, as one count."""

    def __init__(self, show: Callable[[int], None], frames: int) -> None:
        self._show, self._frames = show, frames
        self._run, self._last = 0, -1

    def __call__(self, done: int) -> None:
        if done < self._last:
            self._run += 1
        self._last = done
        self._show(self._run * self._frames + done)


def _chosen(only: str | None) -> tuple[str, ...]:
    if only is None:
        return NAMES
    words = [word.strip() for word in only.split(",") if word.strip()]
    unknown = [word for word in words if word not in NAMES]
    if unknown or not words:
        raise UsageError(
            "unknown experiment",
            where="--only",
            found=", ".join(unknown) or "nothing",
            allowed=", ".join(NAMES),
            next_step=suggest(unknown[0], list(NAMES)) if unknown else "",
        )
    return tuple(name for name in NAMES if name in words)


def _motions(mocap: Path | None) -> Motions:
    """Recordings where there are any, synthetic motion for what is not there."""
    crouch = read_trial(mocap, CROUCH)
    if crouch is None:
        from sim.performer import synthetic_performer

        crouch = synthetic_performer()
    return Motions(crouch, read_trial(mocap, JOG) or made_jog(), read_trial(mocap, JUMP) or made_jump())


def _show(results: Results, path: Path) -> None:
    console = Console()
    if not console.is_terminal:
        console.width = max(console.width, PIPED_WIDTH)
    if results.outcomes:
        console.print(as_table(results.outcomes))
        console.print()
    for file in (path, *results.pictures):
        console.print(f"written: {file}", markup=False, highlight=False, soft_wrap=True)
