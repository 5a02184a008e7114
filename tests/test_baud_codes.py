"""Codes of the baud rate register."""

import pytest

from hardware.dynamixel.baud_codes import baud_of, code_of
from hardware.dynamixel.control_table import ControlTable, find_table, tables

X_RATES = (9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
ONE_RATES = {1: 1_000_000, 3: 500_000, 4: 400_000, 7: 250_000, 9: 200_000, 16: 115_200, 34: 57_600, 103: 19_200}


def test_protocol_two_has_a_list() -> None:
    table = find_table("XM430-W350", 2)
    assert [baud_of(table, code) for code in range(9)] == [*X_RATES, None]
    assert baud_of(table, -1) is None
    small = find_table("XL330-M288", 2)
    assert [baud_of(small, code) for code in range(8)] == [*X_RATES[:7], None]
    assert code_of(small, 4_500_000) is None


def test_protocol_one_divides_two_megahertz() -> None:
    for model in ("MX-28", "AX-12A"):
        table = find_table(model, 1)
        assert {code: baud_of(table, code) for code in ONE_RATES} == ONE_RATES
        assert baud_of(table, 19) == 100_000
        assert baud_of(table, 207) == 9600


def test_only_mx_goes_above_two_megabaud() -> None:
    mx, ax = find_table("MX-64", 1), find_table("AX-12A", 1)
    assert [baud_of(mx, code) for code in (0, 250, 251, 252, 253)] == [2_000_000, 2_250_000, 2_500_000, 3_000_000, None]
    assert [code_of(mx, baud) for baud in (2_000_000, 2_250_000, 3_000_000)] == [0, 250, 252]
    assert code_of(ax, 2_250_000) is None
    assert baud_of(ax, 0) is None
    assert baud_of(ax, 254) == 7843


@pytest.mark.parametrize("table", tables(), ids=lambda one: f"{one.model}-{one.protocol}-{one.firmware[0]}")
def test_every_rate_leads_back_to_its_code(table: ControlTable) -> None:
    register = table["baud_rate"]
    assert register.lowest is not None
    assert register.highest is not None
    rates = {code: baud_of(table, code) for code in range(register.lowest, register.highest + 1)}
    assert None not in rates.values()
    for baud in rates.values():
        assert baud is not None
        code = code_of(table, baud)
        assert code is not None
        found = rates[code]
        assert found is not None
        assert abs(found - baud) <= 0.01 * baud


@pytest.mark.parametrize("baud", [0, -9600, 1, 12_345_678, 6_000_000])
def test_a_rate_that_no_servo_has_is_refused(baud: int) -> None:
    for model, protocol in (("XM430-W350", 2), ("MX-28", 1), ("AX-12A", 1)):
        assert code_of(find_table(model, protocol), baud) is None
