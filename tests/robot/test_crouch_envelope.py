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


@given(st.floats(0.0, 0.4), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_between_the_directions_the_lean_lies_between_theirs(height: float, x: float, y: float) -> None:
    if np.hypot(x, y) > 1e-3:
        most = envelope().most_lean(height, x, y)
        assert envelope().lean.min() - 1e-9 <= most <= envelope().lean.max() + 1e-9


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
