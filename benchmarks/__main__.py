"""`python -m benchmarks`: our frame beside PlaCo and mink, in one run on one core, and what our real frame costs.

Prints the tables that docs/benchmarks.md draws on; `--json FILE` keeps the numbers.
"""

from __future__ import annotations

import os

# One thread for every library, before any of them is loaded.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import argparse
import dataclasses
import json
from pathlib import Path

from benchmarks.bodies import BenchBody, bench_human, bench_op3
from benchmarks.cost import Cost, per_degree_of_freedom, per_sensor
from benchmarks.measure import Outcome, run
from benchmarks.motion import Motion, crouch_and_reach, out_of_reach
from benchmarks.observed import RECORDING, SHARED, observed_benchmark
from benchmarks.observed_cases import Observed
from benchmarks.observed_cost import ObstacleCost
from benchmarks.ours import Ours
from benchmarks.real_frame import FrameCost, real_frame
from benchmarks.recording import followed, recording
from benchmarks.side import Side
from benchmarks.table import print_costs, print_outcomes, print_real_frame
from benchmarks.textbook import Textbook
from retarget.human.calibration import calibrate
from retarget.sources.open import open_source


def main() -> None:
    """Run everything and print it."""
    options = parse()
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    sides = find_sides()
    outcomes: list[Outcome] = []
    human, op3 = bench_human(), bench_op3()
    for body, motion in cases(human, op3, options.frames):
        outcomes += run(body, motion, sides, repeats=options.repeats)
    print(
        f"One process, one core, five iterations, no early stop; synthetic motions: {options.frames} frames at 120 Hz."
    )
    print(f"Sides take turns frame by frame; times are medians over {options.repeats} runs.")
    print_outcomes(outcomes, ours=Ours.name)
    sensors, freedoms = per_sensor(human), per_degree_of_freedom(human, op3)
    print_costs(sensors, freedoms)
    real = real_frame(RECORDING, repeats=options.repeats) if RECORDING.is_file() else []
    print_real_frame(real)
    observed, obstacles = observed_benchmark(frames=options.frames, repeats=options.repeats, plot=options.plot)
    if options.json is not None:
        rows: dict[str, list[Outcome] | list[Cost] | list[FrameCost] | list[Observed] | list[ObstacleCost]]
        rows = {"frames": outcomes, "sensors": sensors, "degrees_of_freedom": freedoms, "real_frame": real}
        rows |= {"observed": observed, "obstacles": obstacles}
        text = json.dumps({key: [dataclasses.asdict(row) for row in part] for key, part in rows.items()}, indent=1)
        options.json.write_text(text + "\n", encoding="utf-8")


def parse() -> argparse.Namespace:
    """Options."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--frames", type=int, default=720, help="frames of each synthetic motion")
    parser.add_argument("--repeats", type=int, default=3, help="runs of which times are medians")
    parser.add_argument("--plot", type=Path, help="PNG for the cost of obstacles")
    parser.add_argument("--json", type=Path, help="file for the numbers")
    return parser.parse_args()


def find_sides() -> list[type[Side]]:
    """Ours, NumPy, and the peers that are installed; the others are named."""
    sides: list[type[Side]] = [Ours]
    try:
        from benchmarks.peer_placo import Placo, PlacoHard

        sides += [PlacoHard, Placo]
    except ImportError as error:
        print(f"without PlaCo: {error}; install the extra 'bench'")
    try:
        from benchmarks.peer_mink import Mink

        sides.append(Mink)
    except ImportError as error:
        print(f"without mink: {error}; install the extra 'bench'")
    return [*sides, Textbook]


def cases(human: BenchBody, op3: BenchBody, frames: int) -> list[tuple[BenchBody, Motion]]:
    """Both bodies, in reach and out of it; a recording where there is one."""
    found = []
    for body in (human, op3):
        easy = crouch_and_reach(body, frames)
        found += [(body, easy), (body, out_of_reach(body, easy))]
    if RECORDING.is_file():
        performer = bench_human(calibrate(open_source(RECORDING)))
        found += [(performer, recording(performer, RECORDING)), followed(op3, RECORDING)]
    else:
        print(f"without the recording: no {RECORDING.name} under {SHARED}")
    return found


if __name__ == "__main__":
    main()
