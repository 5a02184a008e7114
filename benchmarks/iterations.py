"""`python -m benchmarks.iterations FILE`: accuracy of the reconstruction over the iterations of a frame.

Prints a table: five sensors, the recording's rate and thinned to 24 Hz, errors at the instants of the input.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from benchmarks.bodies import Floats
from benchmarks.paper.replay import Replay, replay
from benchmarks.table import print_table
from retarget.frames import SensorFrames
from retarget.model.human import Human, human_limits
from retarget.report.motion_metrics import limit_violations
from retarget.schema.priorities import load_priorities
from retarget.sources.open import open_source

SWEEP = (1, 2, 3, 4, 5, 7, 10, 15, 20)
USUAL = 5
THIN_HZ = 24.0
GROUPS = {"ankles": ("l_ankle", "r_ankle"), "wrists": ("l_wrist", "r_wrist"), "head": ("head",)}


def errors_mm(done: Replay) -> dict[str, Floats]:
    """Errors, mm, of every frame: of the centre of mass and of groups of sensors."""
    groups = {
        group: done.errors_mm[:, [done.sensors.index(one) for one in members]] for group, members in GROUPS.items()
    }
    return {"CoM": done.balance_mm} | groups


def broken_limits(human: Human, postures: Floats, dt: float) -> int:
    """Values of position and speed beyond the human's limits."""
    single, columns = human.body.scalar_joints()
    limits = human_limits(human.body)
    kept = type(limits)(
        limits.lower[single], limits.upper[single], limits.max_velocity[single], limits.max_acceleration[single]
    )
    counted = limit_violations(postures[:, columns[single]], kept, dt, from_rest=False)
    return counted.position + counted.velocity


def row(frames: SensorFrames, iterations: int) -> Iterable[str]:
    """Mean (max) of every group, `human` and `paper`; broken limits of both."""
    broken = 0
    for name in ("human", "paper"):
        done = replay(frames, load_priorities(name), iterations=iterations)
        broken += broken_limits(done.human, done.q, done.dt)
        for group, values in errors_mm(done).items():
            if group != "CoM" or name == "paper":
                yield f"{np.nanmean(values):.3f} ({np.nanmax(values):.2f})"
    yield str(broken)


def main() -> None:
    """Every number of iterations, and the usual one on the thinned recording."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.iterations", description=__doc__)
    parser.add_argument("file", type=Path)
    frames = open_source(parser.parse_args().file)
    thin = frames.resample(np.arange(0.0, frames.duration_s, 1.0 / THIN_HZ))
    print(f"{Path(frames.source).name}, {len(frames)} frames: mean (max), mm; joint limits broken, position and speed")
    heads = ["N_IK", *(f"human: {group}" for group in GROUPS), *(f"paper: {group}" for group in ("CoM", *GROUPS))]
    rows = [[str(count), *row(frames, count)] for count in SWEEP]
    print_table([*heads, "limits"], [*rows, [f"{USUAL}, {THIN_HZ:g} Hz", *row(thin, USUAL)]])


if __name__ == "__main__":
    main()
