"""`python -m benchmarks.ends`: how runs of robots with mass end: after the motion, and by a stop at a random tick.

Each robot follows a motion with and without the table: as planned, with masses, centre of mass, friction and latency
drawn anew, and with servos 0.6 as stiff as planned. None may fall or topple: torque goes off at rest, or the robot
stands with torque.
"""

from __future__ import annotations

import os

# One thread for every library, before any of them is loaded.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import argparse
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product
from multiprocessing import get_context

import numpy as np

from benchmarks.physics_runs import play
from benchmarks.robustness import motion
from benchmarks.table import add_docs, print_table, show_table
from retarget.errors import RetargetError
from retarget.human.samples import Playback
from retarget.run.options import PhysicsOptions, RunOptions
from retarget.sources.open import SAMPLE
from retarget.types import RunState

ROBOTS = ("op3", "poppy", "toddlerbot", "wolfgang")
SCENES = (None, "table")
DRAWN = ("mass", "centre_of_mass", "friction", "latency")
CONDITIONS: dict[str, tuple[str, ...]] = {"planned": (), "drawn": DRAWN, "soft": ("stiffness=0.6",)}
"""What is simulated otherwise than planned: perturbations, those without a number drawn."""


@dataclass(frozen=True)
class Case:
    """One run. stopped: by a stop at a tick that its seed draws; else by the end of the motion."""

    robot: str
    source: str
    scene: str | None
    condition: str
    stopped: bool
    seed: int
    end: float


@dataclass(frozen=True)
class Ended:
    """How it ended. state: of the run; after_s: from the stop, or the end of the motion, to the end of the run; how: it
    went down or why it was refused, "" where it did not."""

    state: str
    after_s: float
    how: str


def run_case(case: Case) -> Ended:
    """Play one."""
    physics = PhysicsOptions(seed=case.seed, perturbations=CONDITIONS[case.condition])
    options = RunOptions(
        robot=case.robot, bus="physics", scene=case.scene, physics=physics, playback=Playback(end=case.end)
    )
    stop_s = float(np.random.default_rng(case.seed).uniform(0.2, 0.95)) * case.end if case.stopped else None
    try:
        run = play(motion(case.source), options, stop_s=stop_s)
    except RetargetError as error:
        return Ended("refused", 0.0, str(error))
    assert run.physics is not None, "the robot has mass"
    following = run.record.time[run.record.following]
    after = float(run.record.time[-1] - following[-1]) if following.size else 0.0
    fallen = run.physics.fall or run.physics.toppled
    return Ended(run.state or "", after, "" if fallen is None else f"at {fallen.time:.1f} s {fallen.how}")


def cases(asked: argparse.Namespace) -> Iterator[Case]:
    """All of them."""
    for robot, scene, condition in product(asked.robot, SCENES, CONDITIONS):
        for seed in range(asked.ends):
            yield Case(robot, asked.source, scene, condition, stopped=False, seed=seed, end=asked.end)
        for seed in range(asked.stops):
            yield Case(robot, asked.source, scene, condition, stopped=True, seed=100 + seed, end=asked.end)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.ends", description=__doc__)
    parser.add_argument("--robot", nargs="*", default=ROBOTS, help="by name or path")
    parser.add_argument("--source", default=SAMPLE, help=f"a motion file [{SAMPLE}]")
    parser.add_argument("--end", type=float, default=6.0, help="end of the motion, s")
    parser.add_argument("--ends", type=int, default=1, help="runs of each kind that end with the motion")
    parser.add_argument("--stops", type=int, default=2, help="runs of each kind that are stopped")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    add_docs(parser)
    asked = parser.parse_args()
    todo = list(cases(asked))
    with ProcessPoolExecutor(asked.jobs, mp_context=get_context("spawn")) as pool:
        ends = list(pool.map(run_case, todo))
    for case, end in zip(todo, ends, strict=True):
        if end.how:
            print(f"{case}: {end.state}: {end.how}")
    heads = [
        "robot",
        "runs",
        "fell or toppled",
        "at rest, torque off",
        "standing, with torque",
        "other",
        "latest end, s",
    ]
    rows: list[list[str]] = []
    for robot in asked.robot:
        own = [end for case, end in zip(todo, ends, strict=True) if case.robot == robot]
        states = [end.state for end in own]
        off, standing = states.count(RunState.OFF.value), states.count(RunState.STANDING.value)
        latest = max((end.after_s for end in own), default=0.0)
        down = sum(bool(end.how) for end in own)
        rows.append([robot, str(len(own)), str(down), str(off), str(standing), str(len(own) - off - standing)])
        rows[-1].append(f"{latest:.1f}")
    print_table(heads, rows, text=1)
    show_table("ends", heads, rows, docs=asked.docs)


if __name__ == "__main__":
    main()
