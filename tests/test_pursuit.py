"""Going after what is asked: no lag on smooth motion, no overshoot after a jump, little of the noise."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from retarget.pursuit import Pace, Pursuit, braking_displacement
from retarget.rotations import FloatArray

DT = 0.008
PACE = Pace(own=4.0, catch_up=2.0, speed=0.5)


def chase(asked: FloatArray, start: float | None = None, *, haste: float = 1.0) -> FloatArray:
    """Where a point gets that goes after asked (T,) m along x and reaches every goal."""
    pursuit = Pursuit(PACE)
    here, last = asked[0] if start is None else start, asked[0]
    track = []
    for there in asked:
        here += pursuit.step((there - last, 0.0, 0.0), (there - here, 0.0, 0.0), DT, haste=haste)[0]
        last = there
        track.append(here)
    return np.array(track)


@given(st.floats(1e-6, 1.0), st.floats(1e-5, 1e-2))
def test_braking_ends_just_at_the_goal(gap: float, change: float) -> None:
    step = braking_displacement(gap, change)
    way, here = 0.0, step
    while here > 0.0:
        way, here = way + here, here - change
    assert way <= gap * (1.0 + 1e-9) + 1e-12
    assert step <= gap


def test_outside_it_goes_straight_back() -> None:
    assert braking_displacement(-0.01, 1e-4) == -0.01


def test_a_jump_is_caught_up_with_once_and_for_all() -> None:
    track = chase(np.r_[np.zeros(5), np.full(400, 0.3)])
    speed = np.diff(track) / DT
    assert track.max() < 0.3 * 1.005
    assert abs(track[-1] - 0.3) < 1e-4
    assert speed.max() <= PACE.speed + PACE.own * DT + 1e-9


def test_a_smooth_motion_is_followed_with_hardly_any_lag() -> None:
    time = np.arange(0.0, 4.0, DT)
    asked = 0.1 * np.sin(2.0 * np.pi * 0.7 * time)
    assert np.abs(chase(asked) - asked)[100:].max() < 0.004


def test_noise_is_not_passed_on() -> None:
    noise = 0.001 * np.random.default_rng(0).standard_normal(1000)
    track = chase(noise)
    assert np.std(np.diff(track, n=2)[50:]) < 0.25 * np.std(np.diff(noise, n=2)[50:])


def test_haste_slows_the_way_there() -> None:
    asked = np.full(400, 0.3)
    slow = np.diff(chase(asked, 0.0, haste=0.2)) / DT
    assert slow.max() <= 0.2 * PACE.speed + 1e-9


def test_a_restart_forgets_the_motion() -> None:
    pursuit = Pursuit(PACE)
    for _ in range(50):
        pursuit.step((0.002, 0.0, 0.0), (0.002, 0.0, 0.0), DT)
    pursuit.restart()
    assert pursuit.step((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), DT) == (0.0, 0.0, 0.0)


def test_ahead_of_an_even_motion_by_just_so_much_time() -> None:
    """Of a jump, which has no motion of its own that is believed at once, it is not ahead for long."""
    ahead, speed = 0.05, 0.3
    asked = speed * DT * np.arange(150)
    pursuit, here, last = Pursuit(PACE, ahead=ahead), 0.0, 0.0
    for there in asked:
        here += pursuit.step((there - last, 0.0, 0.0), (there - here, 0.0, 0.0), DT)[0]
        last = there
    assert here - asked[-1] == pytest.approx(speed * ahead, rel=0.05)
    for _ in range(200):
        here += pursuit.step((0.0, 0.0, 0.0), (last - here, 0.0, 0.0), DT)[0]
    assert here == pytest.approx(last, abs=1e-6)
