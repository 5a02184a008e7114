"""Runs of the synthetic performer as `--save` keeps them."""

from pathlib import Path

import numpy as np

from hardware.clock import VirtualClock
from retarget.cli.buses import make_bus
from retarget.human.samples import Playback
from retarget.recording.npz import write_npz
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from sim.performer import synthetic_performer


def saved_run(path: Path, *, robot: str, seconds: float = 1.0) -> Path:
    """So much of the performer, followed by a robot on the mock bus, or by the human alone."""
    options = RunOptions(robot=robot, playback=Playback(end=seconds))
    with prepare(
        synthetic_performer,
        options,
        clock=VirtualClock(),
        make_bus=lambda body, clock: make_bus(options.bus, body, clock),
    ) as prepared:
        run = prepared.run()
    write_npz(run, path)
    with np.load(path) as saved:
        assert len(saved["time"]) > 50
    return path
