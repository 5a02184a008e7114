"""Feet that nobody wears: planted, following the head when it leaves."""

import pytest

from retarget.human_dimensions import proportional_dimensions
from retarget.virtual_feet import HEAD_LEAD_M, REACH_M, VirtualFeet


def standing() -> VirtualFeet:
    feet = VirtualFeet(proportional_dimensions(1.75))
    feet.start([HEAD_LEAD_M[0], 0.0, 1.6], (1.0, 0.0), crouch=0.0)
    return feet


def test_left_and_right_on_the_ground_under_the_head() -> None:
    left, right = standing().ankles
    assert left == pytest.approx([0.0, -right[1], right[2]]) and left[1] > 0.05
    assert left[2] == pytest.approx(0.039 * 1.75)


def test_they_stay_while_the_head_sways_and_while_it_goes_down() -> None:
    feet = standing()
    before = feet.ankles.copy()
    feet.step([HEAD_LEAD_M[0] + 0.9 * REACH_M, 0.0, 1.6], (1.0, 0.0), crouch=0.0, dt=0.1)
    feet.step([HEAD_LEAD_M[1], 0.0, 0.8], (1.0, 0.0), crouch=1.0, dt=0.1)
    assert (feet.ankles == before).all()


@pytest.mark.parametrize("rate", [24.0, 120.0])
def test_they_follow_at_any_rate(rate: float) -> None:
    feet = standing()
    for k in range(round(2.0 * rate)):
        feet.step([HEAD_LEAD_M[0] + k / rate, 0.0, 1.6], (1.0, 0.0), crouch=0.0, dt=1.0 / rate)
    assert feet.ankles[0, 0] == pytest.approx(2.0 - REACH_M - 0.15, abs=0.05)
