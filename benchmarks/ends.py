"""`python -m benchmarks.ends`: how runs of robots with mass end: after the motion, and by a stop at a random tick.

Each robot follows a motion with and without the table: as planned, with masses, centre of mass, friction and latency
drawn anew, and with servos 0.6 as stiff as planned. Each run gives one end after the motion, and so many stops. In
none may the robot fall, topple or touch itself, or lift or slide a sole by the stop: torque goes off at rest, or it
stands with torque.
`--disturbed`: sensors are lost and jump. `--own-loop`: a loop over `retarget.Pipeline` instead of a run.
`--keep FILE` keeps each run as it ends, a line of JSON, and goes on from what it holds.
"""

from __future__ import annotations

import os

# One thread for every library, before any of them is loaded.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import argparse
from collections.abc import Sequence
from itertools import product
from pathlib import Path

from benchmarks.kept import run_cases
from benchmarks.stops import CONDITIONS, Case, Ended, run_case
from benchmarks.table import add_docs, print_table, show_table
from retarget.sources.open import SAMPLE
from retarget.types import RunState

ROBOTS = ("op3", "poppy", "toddlerbot", "wolfgang")
SCENES = ("none", "table")
MOST_MM = 2.0
"""How far a stop may lift or slide a sole, mm."""
HEADS = (
    *("runs", "fell or toppled", "touched", "at rest, torque off", "standing, with torque", "other"),
    *("most lifted by the stop, mm", "most slid by the stop, mm", "farther than 2 mm", "more than without the stop"),
    *("most tilt, degrees", "most slid until the end, mm", "latest to stand, s", "latest end, s"),
)
DOCS = (0, 1, 2, 3, 4, 5, 6, 7, 13)
"""Columns of the table of the documentation."""


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.ends", description=__doc__)
    parser.add_argument("--robot", nargs="*", default=ROBOTS, help="by name or path")
    parser.add_argument("--source", nargs="*", default=[SAMPLE], help=f"motion files [{SAMPLE}]")
    parser.add_argument("--scene", nargs="*", default=SCENES, help="by name or path")
    parser.add_argument("--condition", nargs="*", default=[*CONDITIONS], choices=[*CONDITIONS])
    parser.add_argument("--end", type=float, default=6.0, help="end of the motion, s")
    parser.add_argument("--seeds", type=int, default=1, help="runs of each kind")
    parser.add_argument("--stops", type=int, default=2, help="stops of each run")
    parser.add_argument("--disturbed", action="store_true", help="sensors are lost and jump")
    parser.add_argument("--own-loop", action="store_true", help="a loop over Pipeline")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--keep", type=Path, help="file for every run; runs that are in it are not made again")
    add_docs(parser)
    asked = parser.parse_args()
    kinds = product(range(asked.seeds), asked.source, asked.robot, asked.scene, asked.condition)
    cases = [
        Case(
            robot=robot,
            source=source,
            scene=None if scene == "none" else scene,
            condition=condition,
            seed=seed,
            end=asked.end,
            stops=asked.stops,
            disturbed=asked.disturbed,
            own_loop=asked.own_loop,
        )
        for seed, source, robot, scene, condition in kinds
    ]
    found = run_cases(cases, run_case, Ended, jobs=asked.jobs, keep=asked.keep)
    ends = [(case, end) for case, ends in found.items() for end in ends]
    for case, end in ends:
        if end.how or end.touched or _far(end):
            print(f"{case}:\n    {end}")
    by_kind = {kind: [end for _, end in ends if end.kind == kind] for kind in sorted({end.kind for _, end in ends})}
    print_table(["kind", *HEADS], [[kind, *cells(own)] for kind, own in by_kind.items()])
    rows = [[robot, *cells([end for case, end in ends if case.robot == robot])] for robot in asked.robot]
    print_table(["robot", *HEADS], rows)
    shown = [[row[0], *(row[1 + column] for column in DOCS)] for row in rows]
    show_table("ends", ["robot", *(HEADS[column] for column in DOCS)], shown, docs=asked.docs)


def cells(ends: Sequence[Ended]) -> list[str]:
    """The cells of a row, as HEADS names them."""
    states = [end.state for end in ends]
    off, standing = states.count(RunState.OFF.value), states.count(RunState.STANDING.value)
    counts = (len(ends), sum(bool(end.how) for end in ends), sum(end.touched > 0 for end in ends), off, standing)
    moved = (max(end.lifted_mm for end in ends), max(end.slid_mm for end in ends)) if ends else (0.0, 0.0)
    return [
        *map(str, (*counts, len(ends) - off - standing)),
        *(f"{mm:.1f}" for mm in moved),
        str(sum(_far(end) for end in ends)),
        str(sum(_far(end, beside=True) for end in ends)),
        f"{max((end.tilt_deg for end in ends), default=0.0):.1f}",
        f"{max((end.rest_slid_mm for end in ends), default=0.0):.1f}",
        f"{max((end.stands_s or 0.0 for end in ends), default=0.0):.2f}",
        f"{max((end.ends_s for end in ends), default=0.0):.1f}",
    ]


def _far(end: Ended, *, beside: bool = False) -> bool:
    """True if a sole got too far; beside: farther by so much than it did in the run that went on."""
    on = (end.on_lifted_mm or 0.0, end.on_slid_mm or 0.0) if beside else (0.0, 0.0)
    return max(end.lifted_mm - on[0], end.slid_mm - on[1]) > MOST_MM


if __name__ == "__main__":
    main()
