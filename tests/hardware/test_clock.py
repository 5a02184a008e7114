"""Clocks: virtual time jumps, real time does not go back."""

from datetime import UTC, datetime

import pytest

from hardware.clock import (
    MonotonicClock,
    PacedClock,
    TickTiming,
    VirtualClock,
    wall_to_monotonic,
)


def test_virtual_time_moves_only_forward() -> None:
    clock = VirtualClock(5.0)
    clock.sleep_until(6.5)
    assert clock.now() == 6.5
    clock.sleep_until(1.0)
    assert clock.now() == 6.5
    clock.advance(0.25)
    assert clock.now() == 6.75


def test_the_monotonic_clock_returns_at_once_when_late() -> None:
    clock = MonotonicClock()
    before = clock.now()
    clock.sleep_until(before - 1.0)
    clock.sleep_until(before + 0.002)
    assert 0.002 <= clock.now() - before < 1.0


def test_a_paced_clock_is_never_faster_than_real_time_and_catches_nothing_up() -> None:
    wall = VirtualClock(100.0)
    clock = PacedClock(3.0, wall=wall)
    clock.sleep_until(3.5)
    assert (clock.now(), wall.now()) == (3.5, 100.5), "real time was waited for"
    wall.advance(0.25)
    assert clock.now() == 3.5, "a slow machine changes nothing of what is computed"
    clock.advance(0.0625)
    clock.sleep_until(3.75)
    assert (clock.now(), wall.now()) == (3.75, 100.75), "computing took some of it"
    wall.advance(2.0)
    clock.sleep_until(4.0)
    assert (clock.now(), wall.now()) == (4.0, 102.75)
    clock.sleep_until(4.5)
    assert (clock.now(), wall.now()) == (4.5, 103.25), "two seconds late, and not caught up"


def test_stamps_of_the_wall_clock_come_onto_the_monotonic_one() -> None:
    before = MonotonicClock().now()
    stamp = datetime.now(tz=UTC).timestamp()
    after = MonotonicClock().now()
    assert before - 0.01 <= stamp + wall_to_monotonic() * 1e-9 <= after + 0.01


PERIOD = 0.01


def paced(pauses: list[float], period: float = PERIOD) -> list[bool]:
    """Whether it is behind at each tick after the first, by pauses in periods."""
    timing, now, behind = TickTiming(period), 5.0, []
    assert timing.begin(now) == 0.0
    for pause in pauses:
        now += pause * PERIOD
        assert timing.begin(now) == pytest.approx(pause * PERIOD)
        behind.append(timing.behind)
    return behind


def test_one_late_tick_is_no_harm_and_two_are() -> None:
    assert paced([1.0, 1.3, 1.5, 1.0, 1.5, 1.0]) == [False] * 6
    assert paced([1.6, 1.6, 1.6, 1.0, 1.6]) == [False, True, True, False, False]


def test_what_is_a_little_late_again_and_again_adds_up() -> None:
    assert paced([1.4, 1.4, 1.4, 1.0]) == [False, False, True, False]
    assert paced([1.3] * 50) == [False] * 50


def test_after_a_restart_no_tick_is_late() -> None:
    timing = TickTiming(PERIOD)
    timing.begin(0.0)
    timing.begin(1.0)
    behind = [timing.behind]
    timing.restart()
    behind.append(timing.behind)
    assert timing.begin(9.0) == 0.0
    assert [*behind, timing.behind] == [True, False, False]
