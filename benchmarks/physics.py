"""`python -m benchmarks.physics`: how many times faster than real time a robot with mass runs, on one core.

OP3 follows the synthetic performer, and CMU 02_06 where that is: human, robot, gate, guard and mechanics, all of it.
Thread CPU, the best of the repeats. `--json FILE` keeps the numbers.
"""

from __future__ import annotations

import os

# One thread for every library, before any of them is loaded.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import argparse
import dataclasses
import json
from pathlib import Path

from benchmarks.physics_runs import PhysicsCost, cost_of_run
from benchmarks.recording import RECORDING
from benchmarks.table import add_docs, show_table
from retarget.frames import SensorFrames
from retarget.human.samples import Playback
from retarget.run.options import RunOptions
from retarget.sources.open import open_source
from sim.performer import synthetic_performer

ASKED = 5.0
"""Times real time."""


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.physics", description=__doc__)
    parser.add_argument("--robot", default="op3", help="by name or path")
    parser.add_argument("--speed", type=float, default=0.5, help="of the performer")
    parser.add_argument("--end", type=float, default=None, help="end at this time of the motion, s")
    parser.add_argument("--repeats", type=int, default=3, help="runs of which the best counts")
    parser.add_argument("--wire", action="store_true", help="through the emulator's bytes as well")
    parser.add_argument("--json", type=Path, help="file for the numbers")
    add_docs(parser)
    asked = parser.parse_args()
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    costs = []
    for bus in ("physics", "physics+wire") if asked.wire else ("physics",):
        options = RunOptions(robot=asked.robot, bus=bus, playback=Playback(speed=asked.speed, end=asked.end))
        for name, frames in motions().items():
            costs.append(best(f"{name}, {bus}", frames, options, repeats=asked.repeats))
    show(costs, docs=asked.docs)
    if asked.json is not None:
        text = json.dumps([dataclasses.asdict(cost) for cost in costs], indent=1)
        asked.json.write_text(text + "\n", encoding="utf-8")


def motions() -> dict[str, SensorFrames]:
    """What there is to follow."""
    found = {"synthetic": synthetic_performer()}
    if RECORDING.is_file():
        found[RECORDING.stem] = open_source(RECORDING)
    else:
        print(f"without the recording: no {RECORDING.name}")
    return found


def best(name: str, frames: SensorFrames, options: RunOptions, *, repeats: int) -> PhysicsCost:
    """The fastest of several runs: what is slower was disturbed."""
    return min((cost_of_run(name, frames, options) for _ in range(repeats)), key=lambda cost: cost.cpu_s)


def show(costs: list[PhysicsCost], *, docs: bool = False) -> None:
    """Print the costs as a table."""
    print(f"Whole runs on one core, thread CPU; asked: {ASKED:g} times real time on `physics`")
    heads = ["motion, bus", "times real time", "us per tick", "physics", "human", "robot", "rest"]
    rows = [
        [
            cost.motion,
            f"{cost.real_time:.1f}",
            *(f"{us:.0f}" for us in (cost.tick_us, cost.physics_us, cost.human_us, cost.robot_us, cost.rest_us)),
        ]
        for cost in costs
    ]
    show_table("physics-speed", heads, rows, docs=docs)


if __name__ == "__main__":
    main()
