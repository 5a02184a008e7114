"""Who was lost comes back turned as it was shown last, and from there, by its weight, to how it is."""

import numpy as np
import pytest

from retarget.frames import SensorSample
from retarget.live.turning_back import TurningBack
from retarget.rotations import FloatArray, from_axis_angle


def sample(angle: float, weight: float | None, *, valid: bool = True) -> SensorSample:
    turn = from_axis_angle([0.0, 0.0, 1.0], angle)[None]
    share: FloatArray | None = None if weight is None else np.array([weight])
    return SensorSample(("head",), np.zeros((1, 3)), turn, np.array([valid]), share)


def angle(shown: SensorSample) -> float:
    return float(2.0 * np.arctan2(shown.orientation[0, 3], shown.orientation[0, 0]))


def test_it_is_turned_by_its_weight_from_where_it_was_last() -> None:
    turning = TurningBack(1)
    assert angle(turning.step(sample(0.3, 1.0))) == pytest.approx(0.3)
    turning.step(sample(2.0, 0.0, valid=False))
    got = [angle(turning.step(sample(1.3, weight))) for weight in (0.0, 0.25, 0.5, 1.0)]
    assert got == pytest.approx([0.3, 0.55, 0.8, 1.3])


def test_who_was_never_known_or_takes_part_in_full_is_as_it_is() -> None:
    turning = TurningBack(1)
    assert angle(turning.step(sample(1.0, 0.1))) == pytest.approx(1.0)
    assert angle(turning.step(sample(0.7, None))) == pytest.approx(0.7)
