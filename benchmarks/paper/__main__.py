"""`python -m benchmarks.paper`: the paper's experiments and figures, run anew.

Pictures like the paper's figures, and a table beside its numbers. Experiments 1 to 3 run with the paper's priorities
and line observers, and with ours and capsules. Obstacles are placed from the motion.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from benchmarks.paper.run import CROUCH, JOG, JUMP, NAMES, Motions, Results, read_trial, run_experiments
from benchmarks.paper.table import show_outcomes
from benchmarks.table import add_docs
from retarget.cli.application import progress_bar
from retarget.cli.exit import exit_code_of
from retarget.errors import UsageError, suggest
from retarget.schema.files import check_folder, make_folder, refuse_existing, write_atomic
from sim.performer import synthetic_performer

DEFAULT_FOLDER = Path("out/paper")
RUNS = 8
"""Reconstructions of the crouching motion: two free ones, and three experiments with two configurations."""
MOST_ITERATIONS = 100


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    asked = _parse(arguments)
    sys.exit(exit_code_of(lambda: _experiments(asked)))


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.paper", description=__doc__)
    recordings = "folder of recordings, searched for CMU 02_06, 02_03 and 02_04; without: no jog and jump"
    parser.add_argument("--mocap", type=Path, metavar="DIR", help=recordings)
    parser.add_argument("--out", type=Path, default=DEFAULT_FOLDER, metavar="DIR", help="for pictures and numbers")
    parser.add_argument("--only", metavar="NAME,...", help=f"some of {', '.join(NAMES)}")
    iterations = "iterations per frame at most (the paper's: 5)"
    parser.add_argument("--n-ik", type=int, metavar="N", help=iterations)
    parser.add_argument("--overwrite", action="store_true", help="replace files that are there")
    add_docs(parser)
    return parser.parse_args(arguments)


def _experiments(asked: argparse.Namespace) -> None:
    """Run what is asked for. Raises UsageError before anything is written, InputError."""
    names, iterations = _chosen(asked.only), _iterations(asked.n_ik)
    check_folder(asked.out, option="--out")
    path = asked.out / "experiments.json"
    if not asked.overwrite and asked.out != DEFAULT_FOLDER:
        refuse_existing(path, option="--out")
    motions = _motions(asked.mocap)
    make_folder(asked.out, option="--out")
    total = RUNS * len(motions.crouch)
    with progress_bar("experiments", total if "crouching" in names else 1) as show:
        results = run_experiments(
            motions,
            asked.out,
            only=names,
            iterations=iterations,
            progress=_Counter(show, len(motions.crouch)),
        )
    write_atomic(path, json.dumps(results.data, indent=2, allow_nan=False).encode(), option="--out")
    _show(results, path, docs=asked.docs)


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


def _iterations(asked: int | None) -> int | None:
    if asked is not None and not 1 <= asked <= MOST_ITERATIONS:
        raise UsageError(
            "impossible number of iterations", where="--n-ik", found=asked, allowed=f"1 to {MOST_ITERATIONS}"
        )
    return asked


def _motions(mocap: Path | None) -> Motions:
    """Recordings where there are any; the synthetic performer crouches too, but neither jogs nor jumps."""
    crouch = read_trial(mocap, CROUCH)
    return Motions(synthetic_performer() if crouch is None else crouch, read_trial(mocap, JOG), read_trial(mocap, JUMP))


def _show(results: Results, path: Path, *, docs: bool) -> None:
    if results.outcomes:
        show_outcomes(results.outcomes, docs=docs)
    for file in (path, *results.pictures):
        print(f"written: {file}")


if __name__ == "__main__":
    main()
