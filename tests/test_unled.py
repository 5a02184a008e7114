"""Time in which nobody leads: added up over short interruptions, forgotten after half a second of goals."""

import pytest

from hardware.unled import LED_S, Unled

DT = 0.008


def led(watch: Unled, start: float, seconds: float) -> float:
    """Goals in every tick, from `start` on; the time after them, s."""
    ticks = round(seconds / DT)
    for tick in range(ticks):
        watch.led(start + tick * DT)
    return start + ticks * DT


def test_time_without_a_goal_counts_from_its_first_tick() -> None:
    watch = Unled()
    watch.led(0.0)
    assert watch.lasted(1.0, on_purpose=False) == 0.0
    assert watch.lasted(1.5, on_purpose=False) == 0.5


@pytest.mark.parametrize(("seconds", "forgotten"), [(LED_S - 4 * DT, False), (LED_S + 4 * DT, True)])
def test_only_half_a_second_of_goals_forgets_earlier_holds(seconds: float, forgotten: bool) -> None:
    watch = Unled()
    assert watch.lasted(0.0, on_purpose=False) == 0.0
    now = led(watch, 1.0, seconds)
    assert watch.lasted(now, on_purpose=False) == (0.0 if forgotten else pytest.approx(now))


def test_a_goal_now_and_then_leads_nowhere() -> None:
    watch, lasted = Unled(), 0.0
    for tick in range(1000):
        if tick % 2:
            watch.led(tick * DT)
        else:
            lasted = watch.lasted(tick * DT, on_purpose=False)
    assert lasted == pytest.approx(998 * DT)


def test_who_holds_it_on_purpose_leads_it() -> None:
    watch = Unled()
    watch.lasted(0.0, on_purpose=False)
    assert watch.lasted(5.0, on_purpose=True) == 0.0
    assert watch.lasted(6.0, on_purpose=False) == 1.0
