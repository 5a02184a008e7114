"""`python -m benchmarks.robustness`: in how many runs under each kind of perturbation a robot with mass stands.

Each seed draws its own perturbation: mass +-10 %, centre of mass 10 mm off, friction 0.5 to 1, latency 30 ms, stiffness
+-30 %, or a push of 3 N for 0.2 s from front, back and side in turn. A robot stands if it has not fallen when it is at
rest, torque off.
`--keep FILE` keeps each run as it ends, a line of JSON, and goes on from what it holds.
"""

from __future__ import annotations

import os

# One thread for every library, before any of them is loaded.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import argparse
import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from benchmarks.kept import run_cases
from benchmarks.physics_runs import Stood, play, stood
from benchmarks.recording import RECORDING
from benchmarks.table import add_docs, print_table, show_table
from retarget.frames import SensorFrames
from retarget.human.samples import Playback
from retarget.run.options import PERTURBATIONS, PhysicsOptions, RunOptions
from retarget.sources.open import open_source
from sim.performer import synthetic_performer

ASKED = 0.95
"""Share of the runs that stand."""
NONE = "none"
SYNTHETIC = "synthetic"


@dataclass(frozen=True)
class Case:
    """One run. source: a file, or SYNTHETIC."""

    robot: str
    source: str
    speed: float
    end: float | None
    perturbation: str
    seed: int


def main() -> None:
    """The command."""
    usual = str(RECORDING) if RECORDING.is_file() else SYNTHETIC
    parser = argparse.ArgumentParser(prog="python -m benchmarks.robustness", description=__doc__)
    parser.add_argument("--robot", default="op3", help="by name or path")
    parser.add_argument("--source", default=usual, help=f"a motion file, or {SYNTHETIC} [{Path(usual).name}]")
    parser.add_argument("--speed", type=float, default=0.5, help="of the performer")
    parser.add_argument("--end", type=float, default=None, help="end at this time of the motion, s")
    parser.add_argument("--seeds", type=int, default=50, help="runs of each kind of perturbation")
    parser.add_argument("--perturb", nargs="*", default=[NONE, *PERTURBATIONS], choices=[NONE, *PERTURBATIONS])
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--keep", type=Path, help="file for every run; runs that are in it are not made again")
    add_docs(parser)
    asked = parser.parse_args()
    cases = [
        Case(asked.robot, asked.source, asked.speed, asked.end, perturbation, seed)
        for seed in range(asked.seeds)
        for perturbation in asked.perturb
    ]
    found = run_cases(cases, run_case, Stood, jobs=asked.jobs, keep=asked.keep)
    motion_name = Path(asked.source).stem
    print(f"{asked.robot}, {motion_name}, speed {asked.speed:g}, {asked.seeds} seeds; asked: {ASKED:.0%} stand")
    show([end for ends in found.values() for end in ends], asked.perturb, docs=asked.docs)


def run_case(case: Case) -> list[Stood]:
    """Play one."""
    physics = PhysicsOptions(seed=case.seed, perturbations=() if case.perturbation == NONE else (case.perturbation,))
    playback = Playback(speed=case.speed, end=case.end)
    options = RunOptions(robot=case.robot, bus="physics", physics=physics, playback=playback)
    return [stood(case.perturbation, case.seed, play(motion(case.source), options))]


@cache
def motion(source: str) -> SensorFrames:
    """What is followed, read once in each process. source: a file, of an AMC also FILE,SKELETON, or SYNTHETIC."""
    path, _, skeleton = source.partition(",")
    return synthetic_performer() if source == SYNTHETIC else open_source(path, skeleton=skeleton or None)


def show(ends: list[Stood], perturbations: Iterable[str], *, docs: bool = False) -> None:
    """Print a table, a row for each kind of perturbation, and that of the documentation."""
    rows = [row(kind, [end for end in ends if end.perturbation == kind]) for kind in perturbations]
    heads = ["perturbation", "stand", "fell following", "fell after a stop", "fell going to rest", "stopped"]
    heads += ["least ZMP margin, mm", "most slip, mm", "most tilt, degrees", "falls at s (seed)"]
    print_table(heads, rows, text=1)
    shown = [[*cells[:2], *cells[6:9]] for cells in rows]
    show_table("robustness", [*heads[:2], *heads[6:9]], shown, docs=docs)
    for reason, count in Counter(re.sub(r"[\d.]+ rad$", "", end.stopped) for end in ends if end.stopped).most_common(5):
        print(f"stopped in {count} runs: {reason.strip()}")


def row(perturbation: str, ends: list[Stood]) -> list[str]:
    """The row of one kind of perturbation."""
    fell = [end for end in ends if end.fallen_at is not None]
    stopped = sum(end.late and bool(end.stopped) for end in fell)
    to_rest = sum(end.late and not end.stopped for end in fell)
    margins = [end.margin_mm for end in ends if end.margin_mm is not None]
    first = ", ".join(f"{end.fallen_at:.1f} ({end.seed})" for end in fell[:4]) + (", ..." if len(fell) > 4 else "")
    return [
        perturbation,
        f"{len(ends) - len(fell)} of {len(ends)}",
        str(len(fell) - stopped - to_rest),
        str(stopped),
        str(to_rest),
        str(sum(bool(end.stopped) for end in ends)),
        f"{min(margins):.1f}" if margins else "-",
        f"{max(end.slip_mm for end in ends):.1f}" if ends else "-",
        f"{max(end.tilt_deg for end in ends):.1f}" if ends else "-",
        first or "-",
    ]


if __name__ == "__main__":
    main()
