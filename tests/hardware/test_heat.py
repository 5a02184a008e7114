"""Heat: a servo that warms as physics lets it is seen to be warm at the right time, from readings of whole degrees."""

from dataclasses import replace
from math import exp, inf

import numpy as np
import pytest

from guard_rig import MAP, Rig
from hardware.guard_state import GuardLimits
from hardware.heat import RATE_S, THERMAL_S, HeatForecast, time_left
from hardware.servo_health import ServoHealth


def warming(time: float, end: float) -> float:
    return end - (end - 25.0) * exp(-time / THERMAL_S)


def test_the_time_left_is_that_of_a_first_order_lag() -> None:
    rate = (warming(101.0, 75.0) - warming(99.0, 75.0)) / 2.0
    left = time_left(warming(100.0, 75.0), rate, 60.0)
    assert warming(100.0 + left, 75.0) == pytest.approx(60.0, abs=0.05)
    assert time_left(40.0, 0.02, 60.0) == inf, "it ends at 46 degrees"
    assert time_left(61.0, -0.1, 60.0) == 0.0


@pytest.mark.parametrize(("end", "known"), [(80.0, True), (45.0, False)])
def test_readings_of_whole_degrees_are_enough(end: float, known: bool) -> None:
    forecast = HeatForecast(60.0, np.array([True, True, False]))
    for time in np.arange(0.0, 180.0, 0.5):
        readings = [round(warming(time, 30.0)), round(warming(time, end)), 59.9]
        forecast.look(time, np.array(readings, dtype=np.float64))
        assert (forecast.soonest is None) == (time < RATE_S)
    first = forecast.soonest
    assert first is not None and (first.left < inf) is known
    if known:
        truly = THERMAL_S * np.log((end - 25.0) / (end - 60.0)) - 180.0
        assert first.column == 1 and first.left == pytest.approx(truly, rel=0.35)


def test_unknown_temperatures_say_nothing() -> None:
    forecast = HeatForecast(60.0)
    for time in range(200):
        forecast.look(float(time), np.array([np.nan, np.nan]))
    assert forecast.soonest is None


def test_the_operator_is_told_once_in_time() -> None:
    """Servos that hold while standing warn at 60 degrees: what is said comes minutes before."""
    limbs = tuple(column > 0 for column in range(len(MAP)))
    health = ServoHealth(MAP, GuardLimits(max_temperature=90.0, warn_temperature=60.0, limbs=limbs))
    states, words, said = Rig().bus.read(), list[str](), list[tuple[float, str]]()
    for second in range(500):
        temperature = np.full(len(MAP), round(warming(float(second), 90.0)), dtype=np.float64)
        health.check(replace(states, time=float(second), temperature=temperature, voltage=states.voltage), None)
        said += [(float(temperature[0]), text) for text in health.warnings.take_news() if "if it goes on so" in text]
        words += [health.heat_words] if health.heat_words else []
    ((then, text),) = said
    assert then < 58.0 and MAP.joints[0] in text and "60 °C" in text
    assert words[-1].endswith("now")
