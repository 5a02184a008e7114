"""Read an exported CSV with numpy alone: give FILE.csv of `retarget export`, or nothing for a short run of our own."""

import sys
import tempfile
from pathlib import Path

import numpy as np

from hardware.clock import VirtualClock
from retarget.recording.exports.formats import export_motion, format_named
from retarget.recording.npz import write_npz
from retarget.recording.read_run import read_run
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from sim.mock_bus import mock_bus
from sim.performer import synthetic_performer


def exported(folder: Path) -> Path:
    """What `retarget run --save` and `retarget export --to csv` leave."""
    clip = synthetic_performer().cut(0.0, 3.0)
    with prepare(lambda: clip, RunOptions(robot="op3"), clock=VirtualClock(), make_bus=mock_bus) as prepared:
        write_npz(prepared.run(), folder / "run.npz")
    export_motion(read_run(folder / "run.npz"), format_named("csv"), folder / "run.csv")
    return folder / "run.csv"


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        table = np.genfromtxt(sys.argv[1] if sys.argv[1:] else exported(Path(place)), delimiter=",", names=True)
    for name in (name for name in table.dtype.names if name.startswith("servo_")):
        error = np.nanmean(np.abs(table[name] - table[name.removeprefix("servo_")]))
        print(f"{name:24s} {error:.4f} rad off what was sent, on average")
