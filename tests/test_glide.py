"""A point that goes after goals which leap: bounds, and arrival without overshoot."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from retarget.glide import Glide

DT, ACCELERATION, SPEED = 0.008, 0.5, 0.1


@settings(max_examples=30)
@given(goals=st.lists(st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)), min_size=1, max_size=8))
def test_whatever_is_asked_it_keeps_its_speed_and_acceleration(goals: list[tuple[float, float]]) -> None:
    glide, way = Glide((0.0, 0.0), acceleration=ACCELERATION, speed=SPEED), [[0.0, 0.0]]
    for goal in goals:
        way += [glide.step(goal, DT).copy() for _ in range(40)]
    velocity = np.diff(np.array(way), axis=0) / DT
    assert np.abs(velocity).max() <= SPEED + 1e-9
    assert np.abs(np.diff(velocity, axis=0, prepend=0.0)).max() <= ACCELERATION * DT + 1e-9


@given(goal=st.floats(-0.2, 0.2))
def test_from_rest_it_arrives_without_overshoot_and_stays(goal: float) -> None:
    glide = Glide((0.0,), acceleration=ACCELERATION, speed=SPEED)
    way = np.array([glide.step((goal,), DT)[0] for _ in range(500)])
    assert (np.abs(way) <= abs(goal) + 1e-12).all()
    assert abs(way[-1] - goal) < 1e-9 and abs(glide.moved[0]) < 1e-9


def test_it_goes_on_as_it_moved() -> None:
    glide = Glide((0.0,), acceleration=ACCELERATION, speed=SPEED)
    glide.restart((0.3,), (0.0008,))
    assert glide.step((0.3,), DT)[0] > 0.3
    assert glide.at[0] - 0.3 <= 0.0008
