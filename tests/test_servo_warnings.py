"""Warnings: told once, ended once, and a robot that goes slower smoothly while its servos are warm."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guard_rig import DT, MAP, Rig
from hardware.guard_state import GuardLimits, GuardState
from hardware.servo_warnings import CALM_S, MOST_NEWS, RAMP_S, ServoWarnings
from hardware.servo_watched import Row, watched
from sim.mock_faults import FaultKind, MockFault

LIMITS = GuardLimits(
    max_temperature=65.0,
    warn_temperature=60.0,
    voltage=(10.0, 14.8),
    warn_voltage=(11.0, 14.0),
    warn_current=1.5,
    current_time=0.5,
    warn_following_error=0.1,
    warn_age=0.025,
)


def still() -> Rig:
    rig = Rig(limits=LIMITS)
    rig.guard.arm()
    return rig


def warnings() -> tuple[ServoWarnings, np.ndarray[tuple[int, int], np.dtype[np.float64]]]:
    rows = watched(LIMITS)
    seen = np.zeros((len(rows), len(MAP)))
    seen[Row.TEMPERATURE], seen[Row.VOLTAGE] = 40.0, 12.0
    return ServoWarnings(MAP.servos, rows, LIMITS.slow_share), seen


def test_a_warm_servo_slows_the_robot_to_half_within_the_limit_and_is_told_once() -> None:
    rig = Rig(MockFault(FaultKind.HOT, first=20, cycles=300, servo=1, value=61.0), limits=LIMITS)
    rig.guard.arm()
    slows, news = [], []
    for _ in range(600):
        rig.run(1, lambda _: rig.gate.position)
        slows.append(rig.guard.health.slow)
        news += rig.guard.health.warnings.take_news()
    assert rig.state() is GuardState.MOVING
    assert news == [
        "warning: servo is hotter than 60 degrees Celsius: elbow (id 2) 61; the robot goes at 50% of its speed",
        news[-1],
    ]
    assert news[-1].startswith("over: servo is hotter than 60 degrees Celsius: elbow (id 2)")
    begun, half = slows.index(next(slow for slow in slows if slow < 1.0)), slows.index(0.5)
    assert 18 <= begun <= 21 and (half - begun) * DT <= RAMP_S
    assert np.abs(np.diff(slows)).max() <= 0.5 * DT / RAMP_S + 1e-9
    assert slows[-1] == 1.0
    # Back at full speed no sooner than all was calm for a while.
    assert next(tick for tick in range(half, 600) if slows[tick] > 0.5) >= 320 + round(CALM_S / DT) - 1


def test_each_tick_is_judged_though_nothing_was_wrong_for_long() -> None:
    """The ramp counts from the tick in which it begins."""
    rig = Rig(MockFault(FaultKind.HOT, first=500, cycles=300, servo=1, value=61.0), limits=LIMITS)
    rig.guard.arm()
    rig.run(500, lambda _: rig.gate.position)
    assert rig.guard.health.slow == pytest.approx(1.0 - 0.5 * DT / RAMP_S)


def test_a_temperature_at_its_level_does_not_begin_and_end_all_the_time() -> None:
    told, seen = warnings()
    for tick in range(2000):
        seen[Row.TEMPERATURE, 0] = 61.0 if tick // 50 % 2 else 59.0
        told.look(seen, tick * DT)
    assert len(told.take_news()) == 1 and told.slow == 0.5


def test_only_what_heat_is_about_slows() -> None:
    for row, value, slows in ((Row.VOLTAGE, 10.5, False), (Row.AGE, 0.05, False), (Row.CURRENT, 1.6, True)):
        told, seen = warnings()
        seen[row, 2] = value
        for tick in range(150):
            told.look(seen, tick * DT)
        assert (told.slow == 0.5) == slows, row
        (text,) = told.take_news()
        assert "waist (id 3)" in text and ("of its speed" in text) == slows


def test_a_short_peak_of_current_is_no_warning() -> None:
    told, seen = warnings()
    for tick in range(300):
        seen[Row.CURRENT, 0] = 5.0 if tick % 50 else 0.0
        told.look(seen, tick * DT)
    assert told.take_news() == [] and told.slow == 1.0


def test_another_servo_is_told_by_itself() -> None:
    told, seen = warnings()
    seen[Row.TEMPERATURE, 0] = 61.0
    told.look(seen, 0.0)
    seen[Row.TEMPERATURE, 1] = 62.0
    told.look(seen, DT)
    first, second = told.take_news()
    assert "shoulder" in first and "elbow" not in first
    assert "elbow" in second and "shoulder" not in second


def test_news_that_nobody_asks_for_are_bounded() -> None:
    told, seen = warnings()
    for tick in range(3 * MOST_NEWS):
        seen[Row.VOLTAGE] = 12.0 if tick % 2 else 10.5
        told.look(seen, 2.0 * tick)
    assert len(told.take_news()) == MOST_NEWS


def test_a_robot_that_was_never_warned_goes_at_full_speed() -> None:
    rig = still()
    rig.run(100, lambda _: rig.gate.position)
    assert rig.guard.health.slow == 1.0 and not rig.guard.health.warnings.busy
    assert rig.guard.health.warnings.take_news() == []


@given(st.lists(st.tuples(st.floats(20.0, 90.0), st.floats(0.0, 0.1)), min_size=1, max_size=60))
@settings(max_examples=60, deadline=None)
def test_the_speed_never_leaps(readings: list[tuple[float, float]]) -> None:
    told, seen = warnings()
    now, before = 0.0, 1.0
    for temperature, elapsed in readings:
        now += elapsed
        seen[Row.TEMPERATURE, 3] = temperature
        told.look(seen, now)
        assert 0.5 <= told.slow <= 1.0
        assert abs(told.slow - before) <= 0.5 * elapsed / RAMP_S + 1e-12
        before = told.slow
