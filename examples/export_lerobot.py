"""A recorded run as a LeRobot dataset (v3.0): give FILE.npz of `run --save` and a new folder, or nothing to try it."""

import sys
import tempfile
from pathlib import Path

import numpy as np
import pyarrow.parquet

from hardware.clock import VirtualClock
from retarget.exporting import export_motion, export_place, format_named, read_run, resampled
from retarget.options import RunOptions
from retarget.prepare import prepare
from retarget.save import write_npz
from sim.emulated_bus import emulated_bus
from sim.performer import synthetic_performer


def emulated(robot, clock):
    """Servos that answer byte for byte, standing."""
    stand = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
    return emulated_bus(robot, clock, start=robot.joint_map.to_ticks(stand))


def main(run: Path, out: Path) -> None:
    """Export what followed, at 50 frames a second, and compare what was done with what was seen."""
    whole = read_run(run)
    motion = resampled(whole.rows(whole.phase == "follow"), 50.0)
    form = format_named("lerobot")
    export_motion(motion, form, export_place(form, run, out), task="Reach.")
    frames = pyarrow.parquet.read_table(out / "data/chunk-000/file-000.parquet")
    done, seen = (np.array(frames[key].to_pylist()) for key in ("action", "observation.state"))
    print(f"{len(frames)} frames of {done.shape[1]} joints; servos {np.abs(done - seen).mean():.4f} rad off")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        if not sys.argv[1:]:
            clip = synthetic_performer().cut(0.0, 3.0)
            with prepare(
                lambda: clip, RunOptions(robot="op3"), clock=VirtualClock(), make_bus=emulated_bus
            ) as prepared:
                write_npz(prepared.run(), Path(folder, "run.npz"))
        main(*map(Path, sys.argv[1:3] or (Path(folder, "run.npz"), Path(folder, "dataset"))))
