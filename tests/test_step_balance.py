"""Where a stepping robot's balance is kept: over both feet, over one, on the way."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from followers import DT, op3
from retarget.priorities import load_priorities
from retarget.stance import plant
from retarget.standing_balance import GRAVITY
from retarget.step_balance import MOST_CORNERS, StepBalance, at_most, balance_in_motion
from retarget.support import convex_hull, support_distance, support_edges

STANCE = plant(op3(), op3().profile.postures.stand)
BALANCE = StepBalance(STANCE, 0.25)
STILL = np.zeros(3)


def depth(region: list[list[float]], x: float, y: float) -> float:
    return BALANCE.depth(region, np.array([x, y, 0.25]), STILL, STILL)


def test_each_region_lies_in_what_carries_and_all_in_the_way() -> None:
    for foot, (region, sole) in enumerate(zip(BALANCE.over, STANCE.soles, strict=True)):
        assert depth(region, *BALANCE.middles[1 + foot].tolist()) > 0.0
        edges = np.array(region)
        corners = convex_hull(sole.outline)
        inward = BALANCE.middles[1 + foot] + 0.25 * (corners - BALANCE.middles[1 + foot])
        assert np.abs(support_distance(inward, edges)).max() < 1e-9
        assert (support_distance(inward, np.array(BALANCE.on_the_way)) > -1e-9).all()
    assert depth(BALANCE.both, 0.0, 0.0) > 0.01 and depth(BALANCE.over[0], 0.0, 0.0) < -0.03
    assert len(BALANCE.on_the_way) <= MOST_CORNERS


def test_capture_point_and_zero_moment_point_count() -> None:
    over = np.array([*BALANCE.middles[1], 0.25])
    time = np.sqrt(0.25 / GRAVITY)
    still = BALANCE.depth(BALANCE.over[0], over, STILL, STILL)
    moving = BALANCE.depth(BALANCE.over[0], over, np.array([0.0, 0.01, 0.0]), STILL)
    pushed = BALANCE.depth(BALANCE.over[0], over, STILL, np.array([0.0, -0.1, 0.0]))
    assert abs(still - moving - 0.01 * time) < 1e-9
    assert abs(still - pushed - 0.1 * 0.25 / GRAVITY) < 1e-9


def test_on_the_way_height_is_no_way_out() -> None:
    """Who may not go aside fast enough gets there no sooner by throwing up its mass."""
    com = np.array([*BALANCE.middles[1], 0.25])
    assert (BALANCE.spaces(BALANCE.on_the_way, com, STILL, DT)[:, 2] == 0.0).all()
    both = BALANCE.spaces(BALANCE.both, np.array([0.0, 0.0, 0.25]), STILL, DT)
    assert (both[1::2, 2] != 0.0).all(), "standing keeps the law of `standing_balance`"
    inside = BALANCE.spaces(BALANCE.on_the_way, com, STILL, DT) @ np.append(com, -1.0)
    assert (inside < 0.0).all()


def test_from_the_edge_of_the_way_a_mass_at_rest_may_be_pushed_back() -> None:
    """Its zero-moment point has to go beyond that edge for it."""
    for nx, ny, offset in BALANCE.on_the_way:
        at = np.array([nx * offset, ny * offset])
        com = np.array([*at, 0.25])
        back = com - np.array([nx, ny, 0.0]) * GRAVITY / 0.25 * 0.003 * DT**2  # as from 3 mm farther out
        spaces = BALANCE.spaces(BALANCE.on_the_way, com, STILL, DT)
        across = spaces[:, :2] @ np.array([nx, ny])
        assert (spaces[np.abs(across) > 0.999] @ np.append(back, -1.0) <= 0.0).all()


@given(x=st.floats(-0.2, 0.2), y=st.floats(-0.2, 0.2))
def test_a_place_is_inside_and_what_is_inside_stays(x: float, y: float) -> None:
    place = BALANCE.place(np.array([x, y]))
    assert depth(BALANCE.both, *place.tolist()) > 0.0
    again = BALANCE.place(place)
    assert np.abs(again - place).max() < 1e-9


def test_distance_is_to_the_outline_of_what_carries() -> None:
    com = np.array([0.0, 0.0, 0.25])
    assert BALANCE.inside(com, (True, True)) > 0.05
    assert BALANCE.inside(com, (True, False)) < 0.0 and BALANCE.inside(com, (False, True)) < 0.0
    left = np.array([*BALANCE.middles[1], 0.25])
    assert BALANCE.inside(left, (True, False)) > 0.03 > BALANCE.inside(left, (False, True))


def test_a_polygon_of_fewer_corners_is_never_larger() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    less = at_most(circle, 16)
    assert len(less) == 16
    assert (support_distance(less, support_edges([circle])) > -1e-12).all()


def test_which_priorities_look_at_motion() -> None:
    assert balance_in_motion(load_priorities("steady")) == 0.22
    assert balance_in_motion(load_priorities("servo")) is None
