"""`python -m benchmarks.iterations FILE`: accuracy of the reconstruction over the iterations of a frame.

Prints a table: five sensors, the recording's rate and thinned to 24 Hz, errors at the
instants of the input.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from benchmarks.bodies import Floats
from benchmarks.table import print_table
from retarget.frames import SensorFrames
from retarget.human.calibration import calibrate
from retarget.human.reconstruction import Reconstructor
from retarget.human.samples import Playback, lay_on_ticks
from retarget.model.human import Human, build_human, human_limits
from retarget.report.motion_metrics import limit_violations
from retarget.schema.performer import load_performer
from retarget.schema.priorities import load_priorities
from retarget.sources.open import open_source

SWEEP = (1, 2, 3, 4, 5, 7, 10, 15, 20)
USUAL = 5
THIN_HZ = 24.0
GROUPS = {"ankles": ("l_ankle", "r_ankle"), "wrists": ("l_wrist", "r_wrist"), "head": ("head",)}


def reconstruct(frames: SensorFrames, human: Human, name: str, iterations: int) -> tuple[dict[str, Floats], int]:
    """Errors (mm, of every tick) of the centre of mass and of groups of sensors, and how many limits were broken."""
    performer = load_performer("five")
    clip = lay_on_ticks(frames, performer=performer, playback=Playback())
    reconstructor = Reconstructor(human, load_priorities(name), performer, iterations=iterations)
    errors, balance, postures = [], [], []
    for tick in range(len(clip)):
        sample = clip.sample(tick)
        done = reconstructor.step(sample, clip.motion_dt) if tick else reconstructor.start(sample)
        errors.append(done.sensor_error)
        balance.append(done.balance_error)
        postures.append(done.q)
    table, sensors = 1e3 * np.array(errors), reconstructor.sensors
    groups = {group: table[:, [sensors.index(one) for one in members]] for group, members in GROUPS.items()}
    return {"CoM": 1e3 * np.array(balance)} | groups, broken_limits(human, np.array(postures), clip.motion_dt)


def broken_limits(human: Human, postures: Floats, dt: float) -> int:
    """Values of position and speed beyond the human's limits."""
    single, columns = human.body.scalar_joints()
    limits = human_limits(human.body)
    kept = type(limits)(
        limits.lower[single], limits.upper[single], limits.max_velocity[single], limits.max_acceleration[single]
    )
    counted = limit_violations(postures[:, columns[single]], kept, dt, from_rest=False)
    return counted.position + counted.velocity


def row(frames: SensorFrames, human: Human, iterations: int) -> Iterable[str]:
    """Mean (max) of every group, `human` and `paper`; broken limits of both."""
    broken = 0
    for name in ("human", "paper"):
        errors, more = reconstruct(frames, human, name, iterations)
        broken += more
        for group, values in errors.items():
            if group != "CoM" or name == "paper":
                yield f"{np.nanmean(values):.3f} ({np.nanmax(values):.2f})"
    yield str(broken)


def main() -> None:
    """Every number of iterations, and the usual one on the thinned recording."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.iterations", description=__doc__)
    parser.add_argument("file", type=Path)
    frames = open_source(parser.parse_args().file)
    human = build_human(calibrate(frames))
    thin = frames.resample(np.arange(0.0, frames.duration_s, 1.0 / THIN_HZ))
    print(f"{Path(frames.source).name}, {len(frames)} frames: mean (max), mm; joint limits broken, position and speed")
    heads = ["N_IK", *(f"human: {group}" for group in GROUPS), *(f"paper: {group}" for group in ("CoM", *GROUPS))]
    rows = [[str(count), *row(frames, human, count)] for count in SWEEP]
    print_table([*heads, "limits"], [*rows, [f"{USUAL}, {THIN_HZ:g} Hz", *row(thin, human, USUAL)]])


if __name__ == "__main__":
    main()
