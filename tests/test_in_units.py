"""Counts as people say them."""

import pytest

from hardware.dynamixel.control_table import find_table
from hardware.dynamixel.in_units import in_units


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("return_delay_time", 2, "4 us"),
        ("return_delay_time", 250, "500 us"),
        ("baud_rate", 3, "1000000"),
        ("baud_rate", 99, ""),
        ("operating_mode", 3, "position"),
        ("operating_mode", 16, ""),
        ("drive_mode", 9, "0x09"),
        ("homing_offset", 1024, "90.0 deg"),
        ("max_position_limit", 2048, "180.0 deg"),
        ("max_voltage_limit", 160, "16 V"),
        ("current_limit", 1000, "2.69 A"),
        ("id", 7, ""),
    ],
)
def test_values_of_an_xm430(name: str, value: int, text: str) -> None:
    assert in_units(find_table("XM430-W350", 2), name, value) == text


def test_protocol_1() -> None:
    table = find_table("MX-28", 1)
    assert (in_units(table, "baud_rate", 1), in_units(table, "return_delay_time", 0)) == ("1000000", "0 us")
