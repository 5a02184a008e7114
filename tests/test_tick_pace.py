"""Late ticks are known; one may be late, two in a row or a long one may not."""

import pytest

from hardware.tick_pace import TickPace

PERIOD = 0.01


def paced(pauses: list[float], period: float = PERIOD) -> list[bool]:
    """Whether it is behind at each tick after the first, by pauses in periods."""
    pace, now, behind = TickPace(period), 5.0, []
    assert pace.begin(now) == 0.0
    for pause in pauses:
        now += pause * PERIOD
        assert pace.begin(now) == pytest.approx(pause * PERIOD)
        behind.append(pace.behind)
    return behind


def test_one_late_tick_is_no_harm_and_two_are() -> None:
    assert paced([1.0, 1.3, 1.5, 1.0, 1.5, 1.0]) == [False] * 6
    assert paced([1.6, 1.6, 1.6, 1.0, 1.6]) == [False, True, True, False, False]


def test_what_is_a_little_late_again_and_again_adds_up() -> None:
    assert paced([1.4, 1.4, 1.4, 1.0]) == [False, False, True, False]
    assert paced([1.3] * 50) == [False] * 50


def test_a_long_one_is_enough() -> None:
    assert paced([1.0, 2.0, 1.0, 2.2, 1.0]) == [False, False, False, True, False]


def test_without_a_period_nothing_is_late() -> None:
    assert paced([1.0, 900.0, 1e6], period=float("inf")) == [False] * 3


def test_after_a_restart_nobody_was_late() -> None:
    pace = TickPace(PERIOD)
    pace.begin(0.0)
    pace.begin(1.0)
    behind = [pace.behind]
    pace.restart()
    behind.append(pace.behind)
    assert pace.begin(9.0) == 0.0
    assert [*behind, pace.behind] == [True, False, False]
