"""Buses as data."""

import pytest

from hardware.bus_spec import BAUDS, BusSpec, fastest_baud
from hardware.servo import SERVO_MODELS, find_model


@pytest.mark.parametrize(("watchdog", "value"), [(0.0, 0), (0.02, 1), (0.2, 10), (2.54, 127)])
def test_the_watchdog_counts_in_steps_of_20_ms(watchdog: float, value: int) -> None:
    assert BusSpec("main", "p", 1000000, 2, (1,), watchdog=watchdog).watchdog_value == value


@pytest.mark.parametrize(("model", "most"), [("AX-12A", 1000000), ("XL330-M288", 4000000), ("XM430-W350", 4500000)])
def test_the_highest_speed_of_a_model(model: str, most: int) -> None:
    assert fastest_baud(find_model(model)) == most


def test_every_model_has_a_speed_of_its_protocol() -> None:
    for model in SERVO_MODELS.values():
        assert all(min(BAUDS[protocol]) < fastest_baud(model) for protocol in model.protocols)
