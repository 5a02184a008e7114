"""The live calibration measures only who stands upright, and says in words who does not."""

import numpy as np
import pytest

from retarget.errors import InputError
from retarget.frames import SensorSample
from retarget.live.rest_capture import RestCapture
from retarget.model.human_dimensions import FRACTIONS, POINTS, proportional_dimensions
from retarget.types import FloatArray

STATURE = 1.68
FIVE = ("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")
UPPER = ("head", "l_wrist", "r_wrist")


def standing() -> dict[str, FloatArray]:
    """Sensors of a person of 1.68 m, arms hanging; z = 0 is the floor."""
    points = dict(zip(POINTS, proportional_dimensions(STATURE).standing(), strict=True))
    floor = points["l_ankle"][2] - FRACTIONS.ankle_height * STATURE
    return {name: points[name] - [0.0, 0.0, floor] for name in FIVE}


def measured(at: dict[str, FloatArray]) -> float:
    """Stature (m) of a second of standing still."""
    capture = RestCapture(where="test")
    position = np.array([at[name] for name in FIVE])
    for tick in range(60):
        capture.take(0.02 * tick, SensorSample(FIVE, position, np.full((5, 4), np.nan), np.ones(5, dtype=bool)))
    return capture.result().dimensions.stature


def leaning(degrees: float) -> dict[str, FloatArray]:
    """The upper body turned forward about the hips."""
    at, angle = standing(), np.deg2rad(degrees)
    hips = np.array([0.0, 0.0, 0.5 * STATURE])
    turn = np.array([[np.cos(angle), 0.0, np.sin(angle)], [0.0, 1.0, 0.0], [-np.sin(angle), 0.0, np.cos(angle)]])
    return at | {name: hips + turn @ (at[name] - hips) for name in UPPER}


def test_who_stands_upright_is_measured_within_two_percent() -> None:
    assert measured(standing()) == pytest.approx(STATURE, rel=0.02)
    assert measured(leaning(8.0)) == pytest.approx(STATURE, rel=0.02)


@pytest.mark.parametrize(
    ("at", "found"),
    [
        (leaning(25.0), "your head is 0.[23]. m ahead of your feet"),
        (standing() | {"head": standing()["head"] + [0.3, 0.0, -0.05]}, "your head is 0.2. m ahead of your feet"),
        (standing() | {"head": standing()["head"] - [0.0, 0.2, 0.0]}, "your head is 0.20 m to the right of your feet"),
        (standing() | {"l_ankle": standing()["l_ankle"] + [0.05, 0.0, 0.1]}, "left foot is 0.10 m above your right"),
        (
            standing() | {name: standing()[name] + [0.55, 0.0, 0.5] for name in ("l_wrist", "r_wrist")},
            "your hands are 0.5. m ahead of your head",
        ),
    ],
)
def test_who_does_not_is_told_why(at: dict[str, FloatArray], found: str) -> None:
    with pytest.raises(InputError, match=found):
        measured(at)
