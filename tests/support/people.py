"""People of known size for tests: four recorded skeletons, and points of the human in a posture."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from retarget.frames import SensorFrames
from retarget.model.human import Human
from retarget.model.human_dimensions import PARENTS, POINTS, HumanDimensions
from retarget.sources.asf_amc import read_amc
from retarget.types import FloatArray

TRIALS = ("02_01", "01_01", "05_13", "49_18")
"""One trial of each recorded person."""


def trial(shared: Path, name: str) -> SensorFrames:
    return read_amc(shared / "mocap" / "cmu_asfamc" / f"{name}.amc")


def place(human: Human, q: FloatArray, names: Sequence[str]) -> FloatArray:
    """World positions (k, 3) of frames of the human in posture q."""
    frames = [human.body.frame(name) for name in names]
    local = np.array([frame.position for frame in frames])
    return np.asarray(human.body.solver_body().points(q[None], [frame.body for frame in frames], local)[0])


def at_rest(person: HumanDimensions, arms: float, *, turn: float = 0.0, splay: float = 0.05) -> dict[str, FloatArray]:
    """Every point of a person with straight limbs, the arms at an angle from hanging, the soles on the ground."""
    points: dict[str, FloatArray] = {}
    for name, parent in zip(POINTS, PARENTS, strict=True):
        side = 1.0 if name.startswith("l_") else -1.0
        angle = arms if name[2:] in ("elbow", "wrist", "hand") else splay if name[2:] in ("knee", "ankle") else 0.0
        offset = person.of(name)
        if angle:
            offset = person.length(name) * np.array([0.0, side * np.sin(angle), -np.cos(angle)])
        points[name] = offset + (points[POINTS[parent]] if parent >= 0 else 0.0)
    lift = 0.039 * person.stature - points["l_ankle"][2]
    cosine, sine = np.cos(turn), np.sin(turn)
    matrix = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return {name: matrix @ point + [2.0, -1.0, lift] for name, point in points.items()}
