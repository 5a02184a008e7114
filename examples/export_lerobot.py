"""A recorded run as a LeRobot dataset (v3.0): give FILE.npz of `run --save` and a new folder, or nothing to try it."""

import sys
import tempfile
from pathlib import Path

import numpy as np
import pyarrow.parquet
import typer

from hardware.clock import VirtualClock
from retarget import RunOptions, load_robot, read_run
from retarget.recording.exports.formats import export_motion, format_named
from retarget.recording.motion import followed, resampled
from retarget.recording.npz import write_npz
from retarget.run.prepare import prepare
from sim.mock_bus import MockBus
from sim.performer import synthetic_performer


def main(run: Path, out: Path) -> None:
    """Export what followed, 50 frames a second; compare what was done with what was seen."""
    whole = read_run(run)
    motion = resampled(followed(whole, found="nothing"), 50.0)
    export_motion(motion, format_named("lerobot"), out, task="Reach and crouch.")
    frames = pyarrow.parquet.read_table(out / "data/chunk-000/file-000.parquet")
    done, seen = (np.array(frames[key].to_pylist()) for key in ("action", "observation.state"))
    print(f"{len(frames)} frames; servos {np.abs(done - seen).mean():.4f} rad off")


if __name__ == "__main__":
    if sys.argv[1:]:
        sys.exit(typer.run(main))
    with tempfile.TemporaryDirectory() as place:
        clip, servos = synthetic_performer().cut(0.0, 3.0), load_robot("op3").joint_map.servos
        bus = MockBus(servos, clock := VirtualClock())
        with prepare(lambda: clip, RunOptions(robot="op3"), clock=clock, make_bus=lambda *_: bus) as prepared:
            write_npz(prepared.run(), run := Path(place, "run.npz"))
        main(run, Path(place, "dataset"))
