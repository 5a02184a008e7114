"""People of known size for tests: four recorded skeletons, and points of the human in a posture."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from retarget.frames import SensorFrames
from retarget.human import Human
from retarget.rotations import FloatArray
from retarget.sources.asf_amc import read_amc

TRIALS = ("02_01", "01_01", "05_13", "49_18")
"""One trial of each recorded person."""


def trial(shared: Path, name: str) -> SensorFrames:
    return read_amc(shared / "mocap" / "cmu_asfamc" / f"{name}.amc")


def place(human: Human, q: FloatArray, names: Sequence[str]) -> FloatArray:
    """World positions (k, 3) of frames of the human in posture q."""
    frames = [human.body.frame(name) for name in names]
    local = np.array([frame.position for frame in frames])
    return np.asarray(human.body.solver_body().points(q[None], [frame.body for frame in frames], local)[0])
