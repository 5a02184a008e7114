"""Where the pelvis of a performer on one foot is asked."""

import numpy as np
import pytest

from retarget.carrying_feet import Carrying
from retarget.pelvis_over_foot import PelvisOverFoot

LEFT, RIGHT = np.array([0.0, 0.035, 0.03]), np.array([0.0, -0.035, 0.03])


def settled(carrying: Carrying, pelvis: tuple[float, float, float], apart: tuple[float, float, float]) -> list[float]:
    over = PelvisOverFoot(LEFT, RIGHT)
    for _ in range(1000):
        offset = over.step(pelvis, apart, carrying, 0.008)
    return list(offset)


def test_on_both_feet_it_is_where_it_was() -> None:
    assert settled(Carrying.BOTH, (0.02, 0.0, 0.2), (0.1, 0.07, 0.0)) == [0.0, 0.0, 0.0]
    assert settled(Carrying.FLIGHT, (0.02, 0.0, 0.2), (0.1, 0.07, 0.0)) == [0.0, 0.0, 0.0]


def test_who_lifts_a_foot_does_not_crouch() -> None:
    """The middle of both ankles rises by half of what the foot does."""
    assert settled(Carrying.LEFT, (0.0, 0.0, 0.15), (0.0, 0.07, -0.1))[2] == pytest.approx(0.05)
    assert settled(Carrying.RIGHT, (0.0, 0.0, 0.15), (0.0, 0.07, 0.1))[2] == pytest.approx(0.05)


def test_aside_it_is_as_far_from_the_foot_as_on_the_performer() -> None:
    """Hips over the left ankle, feet 0.1 apart: the robot's hips are over its left ankle."""
    offset = settled(Carrying.LEFT, (0.0, 0.05, 0.2), (0.0, 0.1, 0.0))
    assert 0.05 + offset[1] == pytest.approx(LEFT[1])


def test_fore_and_aft_it_is_over_what_it_is_nearer_to() -> None:
    walker = (0.01, 0.0, 0.2)
    assert walker[0] + settled(Carrying.LEFT, walker, (-0.2, 0.07, 0.0))[0] == pytest.approx(0.01)
    balancing = (-0.08, 0.0, 0.2)  # a leg is held out to the front, the hips are over the other
    assert balancing[0] + settled(Carrying.LEFT, balancing, (-0.16, 0.07, 0.0))[0] == pytest.approx(0.0, abs=1e-6)


def test_it_goes_there_smoothly() -> None:
    over = PelvisOverFoot(LEFT, RIGHT)
    path = np.array([over.step((0.0, 0.0, 0.2), (0.0, 0.07, -0.1), Carrying.LEFT, 0.008) for _ in range(100)])
    assert np.abs(np.diff(path, axis=0)).max() < 0.003
