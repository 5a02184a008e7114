"""How low and how far a robot gets on its soles."""

from functools import cache

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from followers import op3
from retarget.ik.support_polygon import plant
from retarget.robot.crouch_envelope import Envelope, measure_envelope
from retarget.robot.following_limits import following_limits


@cache
def envelope() -> Envelope:
    stance = plant(op3(), op3().profile.postures.stand)
    return measure_envelope(op3(), following_limits(op3(), stance), stance, edges=stance.edges(0.01))


def test_the_op3_crouches_to_bent_knees_and_stands_on_nearly_straight_ones() -> None:
    # Sole to ankle 0.0305, shin and thigh 0.22 straight; knees bend from 11 to 148 degrees.
    assert 0.08 < envelope().lowest < 0.10
    assert 0.24 < envelope().highest < 0.2507


def test_it_leans_less_when_it_crouches() -> None:
    forward = envelope().lean[:, 0]
    assert np.deg2rad(20.0) < forward[0] < np.deg2rad(50.0)
    assert forward[-2] > 1.3 * forward[0]


def test_left_and_right_are_alike() -> None:
    lean = envelope().lean
    assert np.allclose(lean[:-1, 1], lean[:-1, 3], atol=0.02)


@given(st.floats(0.0, 0.4), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_between_the_directions_the_lean_lies_between_theirs(height: float, x: float, y: float) -> None:
    if np.hypot(x, y) > 1e-3:
        most = envelope().most_lean(height, x, y)
        assert envelope().lean.min() - 1e-9 <= most <= envelope().lean.max() + 1e-9


def test_in_a_direction_it_is_what_was_measured() -> None:
    for row, height in enumerate(envelope().heights):
        for column, (x, y) in enumerate([(1.0, 0.0), (0.0, 2.0), (-3.0, 0.0), (0.0, -1.0)]):
            assert np.isclose(envelope().most_lean(float(height), x, y), envelope().lean[row, column])


def test_a_robot_that_cannot_crouch_has_one_lean() -> None:
    stiff = Envelope(np.full(9, 0.4), np.full((9, 4), 0.2))
    for one in (stiff, stiff.below(0.3)):
        assert np.allclose([one.most_lean(0.3, 1.0, 0.0), one.most_lean(0.5, 0.0, 1.0)], 0.2)


def test_below_some_height_the_lean_is_what_it_was() -> None:
    top = 0.5 * (envelope().lowest + envelope().highest)
    part = envelope().below(top)
    assert part.highest == top and part.lowest == envelope().lowest
    for height in (part.lowest, 0.5 * (part.lowest + top), top):
        assert abs(part.most_lean(height, 1.0, 0.0) - envelope().most_lean(height, 1.0, 0.0)) < 0.02
    assert envelope().below(1.0).highest == envelope().highest
    assert envelope().below(0.0).highest > envelope().lowest, "some of it is always left"
