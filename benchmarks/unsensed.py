"""`python -m benchmarks.unsensed FILE...`: how far the joints that no sensor sees are from the recorded ones, mean mm.

A mean over the files stands below.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from benchmarks.paper.replay import replay
from benchmarks.table import add_docs, show_table
from retarget.frames import SensorFrames
from retarget.model.human_dimensions import POINTS
from retarget.report.measure import UNSENSED
from retarget.schema.performer import load_performer
from retarget.schema.priorities import load_priorities
from retarget.sources.open import open_source

SETS = {
    "five, paper": ("paper", "five"),
    "five, human": ("human", "five"),
    "with head orientation": ("human", "five_head"),
    "with pelvis": ("human", "six"),
    "ten": ("human", "ten"),
    "head and hands": ("human", "three"),
}
"""Priority file and performer of every column, by its head."""


def unsensed_mm(frames: SensorFrames, priorities: str, sensors: str) -> float:
    """Mean distance from the recorded ones of the joints that no sensor sits on, mm, as `unsensed_mm` of a report."""
    assert frames.joints is not None, f"{frames.source} does not know the whole body"
    joints = replay(frames, load_priorities(priorities), sensors=sensors).joints
    sensed = {sensor.joint for sensor in load_performer(sensors).sensors.values()}
    known = [name for name in UNSENSED if name in frames.joints.names and name not in sensed]
    off = [joints[:, POINTS.index(name)] - frames.joints.of(name) for name in known]
    return float(1e3 * np.linalg.norm(off, axis=-1).mean())


def main() -> None:
    """Every file with every set of sensors."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.unsensed", description=__doc__)
    parser.add_argument("files", type=Path, nargs="+")
    add_docs(parser)
    asked = parser.parse_args()
    rows = [[unsensed_mm(open_source(path), *one) for one in SETS.values()] for path in asked.files]
    named = zip([*(path.stem for path in asked.files), "mean"], [*rows, np.mean(rows, axis=0)], strict=True)
    table = [[name, *(f"{value:.1f}" for value in row)] for name, row in named]
    show_table("unsensed", ["recording", *SETS], table, docs=asked.docs)


if __name__ == "__main__":
    main()
