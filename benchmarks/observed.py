"""`python -m benchmarks.observed`: our frame with collision observers beside PlaCo and mink on the same pairs, and what
obstacles cost.

Prints the tables that docs/benchmarks.md draws on; `--plot FILE.png` draws the cost of obstacles, `--json FILE` keeps
the numbers.
"""

from __future__ import annotations

import os

# One thread for every library, before any of them is loaded.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import argparse
import dataclasses
import json
from pathlib import Path

from benchmarks.observed_cases import Observed, cases, entries, run_observed
from benchmarks.observed_cost import FRAMES, ObstacleCost, obstacle_costs, plot_costs
from benchmarks.observed_table import print_observed, print_obstacle_costs

SHARED = Path(os.environ.get("RETARGET_SHARED", str(Path(__file__).resolve().parent.parent.parent / "shared")))
RECORDING = SHARED / "mocap" / "cmu_asfamc" / "02_06.amc"


def observed_benchmark(
    *, frames: int, repeats: int, plot: Path | None = None
) -> tuple[list[Observed], list[ObstacleCost]]:
    """Run everything with observers and print it."""
    recorded = RECORDING if RECORDING.is_file() else None
    if recorded is None:
        print(f"without the recording: no {RECORDING.name} under {SHARED}")
    rows: list[Observed] = []
    for watched, motion in cases(frames, recorded):
        rows += run_observed(watched, motion, entries(watched, motion), repeats=repeats)
    print_observed(rows)
    costs = obstacle_costs(frames=min(frames, FRAMES), repeats=repeats)
    print_obstacle_costs(costs)
    if plot is not None:
        plot_costs(costs, plot)
    return rows, costs


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.observed", description=__doc__)
    parser.add_argument("--frames", type=int, default=720, help="frames of each synthetic motion")
    parser.add_argument("--repeats", type=int, default=3, help="runs of which times are medians")
    parser.add_argument("--plot", type=Path, help="PNG for the cost of obstacles")
    parser.add_argument("--json", type=Path, help="file for the numbers")
    options = parser.parse_args()
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    rows, costs = observed_benchmark(frames=options.frames, repeats=options.repeats, plot=options.plot)
    if options.json is not None:
        parts: dict[str, list[Observed] | list[ObstacleCost]]
        parts = {"observed": rows, "obstacles": costs}
        text = json.dumps({key: [dataclasses.asdict(row) for row in part] for key, part in parts.items()}, indent=1)
        options.json.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
