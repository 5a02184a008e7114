"""`python -m benchmarks.unsensed FILE...`: how far the joints that no sensor sees are from the recorded ones, mean mm.

Prints the table of docs/how-it-works.md; a mean over the files stands below.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from benchmarks.paper.replay import replay
from benchmarks.table import print_table
from retarget.frames import SensorFrames
from retarget.model.human_dimensions import POINTS
from retarget.report.measure import UNSENSED
from retarget.schema.priorities import load_priorities
from retarget.sources.open import open_source

SETS = (("paper", "five"), ("human", "five"), ("human", "five_head"), ("human", "six"), ("human", "ten"),
        ("human", "all"), ("human", "three"))  # fmt: skip


def unsensed_mm(frames: SensorFrames, priorities: str, sensors: str) -> float:
    """Mean distance of the joints that five sensors do not see from the recorded ones, mm."""
    assert frames.joints is not None, f"{frames.source} does not know the whole body"
    joints = replay(frames, load_priorities(priorities), sensors=sensors).joints
    known = [name for name in UNSENSED if name in frames.joints.names]
    off = [joints[:, POINTS.index(name)] - frames.joints.of(name) for name in known]
    return float(1e3 * np.linalg.norm(off, axis=-1).mean())


def main() -> None:
    """Every file with every set of sensors."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.unsensed", description=__doc__)
    parser.add_argument("files", type=Path, nargs="+")
    files = parser.parse_args().files
    rows = [[unsensed_mm(open_source(path), *one) for one in SETS] for path in files]
    table = [[path.stem, *(f"{value:.1f}" for value in row)] for path, row in zip(files, rows, strict=True)]
    means = ["mean", *(f"{value:.1f}" for value in np.mean(rows, axis=0))]
    print_table(["recording", *(f"{priorities}, {sensors}" for priorities, sensors in SETS)], [*table, means])


if __name__ == "__main__":
    main()
