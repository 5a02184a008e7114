"""Feet of a robot that hangs are asked no closer to each other sideways than it stands, and else where they were."""

from functools import cache

import pytest
from hypothesis import given
from hypothesis import strategies as st

from followers import op3
from retarget.feet_apart import KNEE, FeetApart, feet_apart
from retarget.robot_body import load_robot
from retarget.scalar_rotations import Vector
from retarget.stance import plant

ROBOTS = ("op3", "poppy", "toddlerbot", "wolfgang")
LEAST = 0.1
reach = st.floats(-0.5, 0.5)


@cache
def of(name: str) -> FeetApart | None:
    robot = load_robot(name, root="suspended")
    stance = plant(robot, robot.profile.postures.stand)
    return feet_apart(robot.profile, stance, tuple(robot.profile.landmarks))


@pytest.mark.parametrize("name", ROBOTS)
def test_every_robot_keeps_its_left_foot_to_the_left_by_as_much_as_it_stands(name: str) -> None:
    feet = of(name)
    assert feet is not None
    rows = tuple(load_robot(name).profile.landmarks)
    assert (rows[feet.left], rows[feet.right]) == ("l_sole", "r_sole")
    assert 0.03 < feet.least < 0.3


def test_a_robot_without_two_feet_keeps_nothing() -> None:
    profile = op3().profile
    stance = plant(op3(), profile.postures.stand)
    assert feet_apart(profile, stance, ("l_hand", "r_hand", "l_sole")) is None


def ask(left: Vector, right: Vector) -> tuple[Vector, Vector]:
    landmarks = [right, (1.0, 2.0, 3.0), left]
    FeetApart(left=2, right=0, least=LEAST).ask(landmarks)
    assert landmarks[1] == (1.0, 2.0, 3.0)
    return landmarks[2], landmarks[0]


@given(reach, reach, st.floats(LEAST * (1.0 + KNEE), 0.5))
def test_what_is_asked_far_apart_stays(x: float, y: float, apart: float) -> None:
    left, right = (x, y + apart, 0.1), (0.0, y, 0.0)
    now = ask(left, right)
    assert now[0] == pytest.approx(left, abs=1e-12) and now[1] == pytest.approx(right, abs=1e-12)


@given(reach, reach)
def test_feet_that_meet_or_cross_pass_beside_each_other(left: float, right: float) -> None:
    first, second = ask((0.1, left, 0.2), (-0.1, right, 0.0))
    assert first[1] - second[1] >= LEAST - 1e-12
    assert first[1] + second[1] == pytest.approx(left + right, abs=1e-12)
    assert (first[0], first[2], second[0], second[2]) == (0.1, 0.2, -0.1, 0.0)


@given(st.floats(-0.3, 0.3), st.floats(1e-6, 1e-3))
def test_no_leap_and_no_turning_back(apart: float, more: float) -> None:
    """As feet come closer, what is asked comes closer as well, and never faster."""
    here, there = (ask((0.0, way, 0.0), (0.0, 0.0, 0.0)) for way in (apart, apart + more))
    grown = (there[0][1] - there[1][1]) - (here[0][1] - here[1][1])
    assert -1e-12 <= grown <= more + 1e-12
