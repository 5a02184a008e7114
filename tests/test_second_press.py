"""A key that is held is pressed once, however fast and from when on it repeats."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from retarget.cli.second_press import SecondPress


def presses(*times: float) -> list[bool]:
    key = SecondPress()
    return [key.pressed(1, time) for time in times]


def test_pressed_again_it_is() -> None:
    assert presses(5.0, 6.3) == [False, True]
    assert presses(0.0, 60.0) == [False, True]


def test_twice_in_haste_is_once_until_it_is_pressed_again() -> None:
    assert presses(5.0, 5.3, 5.9, 7.0) == [False, False, False, True]


@settings(max_examples=60)
@given(
    delay=st.floats(0.15, 1.0),
    period=st.floats(0.01, 0.12),
    tick=st.floats(0.004, 0.02),
    phase=st.floats(0.0, 1.0),
)
def test_held_it_is_not(delay: float, period: float, tick: float, phase: float) -> None:
    """For 4 s, looked at in every tick."""
    repeats = [phase, *(phase + delay + period * count for count in range(int(3.0 / period)))]
    key, seen = SecondPress(), 0
    for look in range(int(5.0 / tick)):
        now = look * tick
        come = sum(time <= now for time in repeats)
        assert not key.pressed(come - seen, now)
        seen = come


@pytest.mark.parametrize("stall", [0.25, 1.0])
def test_held_and_read_late_it_is_not(stall: float) -> None:
    key = SecondPress()
    key.pressed(1, 0.0)
    now = 0.5
    while now < 3.0:
        assert not key.pressed(1, now)
        now += 0.033
    assert not key.pressed(int(stall / 0.033), now + stall)
    assert not key.pressed(0, now + stall + 0.01)
    assert not key.pressed(1, now + stall + 0.02)
