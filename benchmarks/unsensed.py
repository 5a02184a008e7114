"""`python -m benchmarks.unsensed FILE...`: how far the joints that no sensor sees are from the recorded ones, mean mm.

Prints the table of docs/how-it-works.md; a mean over the files stands below.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from benchmarks.table import print_table
from retarget.frames import SensorFrames
from retarget.human.calibration import calibrate, rest_orientations
from retarget.human.reconstruction import Reconstructor
from retarget.human.samples import Playback, lay_on_ticks
from retarget.model.human import build_human
from retarget.model.human_dimensions import POINTS
from retarget.report.measure import UNSENSED
from retarget.schema.performer import load_performer
from retarget.schema.priorities import load_priorities
from retarget.sources.open import open_source

SETS = (("paper", "five"), ("human", "five"), ("human", "five_head"), ("human", "six"), ("human", "ten"),
        ("human", "all"), ("human", "three"))  # fmt: skip


def unsensed_mm(frames: SensorFrames, priorities: str, sensors: str) -> float:
    """Mean distance of the joints that five sensors do not see from the recorded ones, mm."""
    assert frames.joints is not None, f"{frames.source} does not know the whole body"
    performer = load_performer(sensors)
    rest = None if frames.skeleton is None else rest_orientations(frames.skeleton)
    reconstructor = Reconstructor(build_human(calibrate(frames)), load_priorities(priorities), performer, rest=rest)
    clip = lay_on_ticks(frames, performer=performer, playback=Playback())
    joints = np.array(
        [
            (
                reconstructor.step(clip.sample(tick), clip.motion_dt) if tick else reconstructor.start(clip.sample(0))
            ).joints
            for tick in range(len(clip))
        ]
    )
    known = [name for name in UNSENSED if name in frames.joints.names]
    off = [joints[:, POINTS.index(name)] - frames.joints.of(name)[: len(joints)] for name in known]
    return float(1e3 * np.linalg.norm(off, axis=-1).mean())


def main() -> None:
    """Every file with every set of sensors."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.unsensed", description=__doc__)
    parser.add_argument("files", type=Path, nargs="+")
    rows = []
    for path in parser.parse_args().files:
        frames = open_source(path)
        rows.append([unsensed_mm(frames, *one) for one in SETS])
    names = [path.stem for path in parser.parse_args().files]
    table = [[name, *(f"{value:.1f}" for value in row)] for name, row in zip(names, rows, strict=True)]
    means = ["mean", *(f"{value:.1f}" for value in np.mean(rows, axis=0))]
    print_table(["recording", *(f"{priorities}, {sensors}" for priorities, sensors in SETS)], [*table, means])


if __name__ == "__main__":
    main()
