"""A share of a step: no joint beyond its speed, and none that changes faster than it can."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from retarget.rotations import FloatArray
from retarget.speed_share import taken_of

MOST, CHANGE = np.array([0.01, 0.02, 0.01]), np.array([0.002, 0.002, 0.004])
STEPS = st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3).map(np.array)


def test_a_step_that_is_short_enough_is_taken_whole() -> None:
    assert taken_of(MOST, MOST, most=MOST, change=CHANGE) == 1.0
    assert taken_of(np.zeros(3), MOST, most=MOST, change=CHANGE) == 1.0


@given(way=st.lists(STEPS, min_size=5, max_size=60))
@settings(max_examples=60, deadline=None)
def test_from_rest_no_joint_exceeds_its_speed_by_more_than_one_change(way: list[FloatArray]) -> None:
    before = np.zeros(3)
    for wish in way:
        step = before + wish * CHANGE  # what its servos can
        share = taken_of(step, before, most=MOST, change=CHANGE)
        assert 0.0 < share <= 1.0
        taken = share * step
        assert (np.abs(taken - before) <= CHANGE * (1.0 + 1e-9)).all()
        assert (np.abs(taken) <= MOST + CHANGE).all()
        before = taken


def test_who_goes_on_and_on_is_at_the_speed_and_not_beyond() -> None:
    before, fastest = np.zeros(3), 0.0
    for _ in range(100):
        step = before + CHANGE
        before = taken_of(step, before, most=MOST, change=CHANGE) * step
        fastest = max(fastest, float((before / MOST).max()))
    assert 0.99 < fastest <= 1.0 + 1e-9


def test_who_was_faster_slows_down_as_fast_as_it_can_and_no_faster() -> None:
    before = np.array([0.02, 0.0, 0.0])
    taken = taken_of(before, before, most=MOST, change=CHANGE) * before
    assert taken.tolist() == pytest.approx([0.018, 0.0, 0.0])
