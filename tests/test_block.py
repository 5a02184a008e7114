"""Registers side by side, by name."""

import pytest

from hardware.dynamixel.answers import side_by_side
from hardware.dynamixel.block import block_of
from hardware.dynamixel.control_table import find_table
from hardware.dynamixel.packets import Status
from hardware.errors import HardwareError
from support.messages import refuses


@pytest.mark.parametrize(("model", "protocol"), [("XM430-W350", 2), ("XL430-W250", 2), ("MX-28", 1), ("AX-12A", 1)])
def test_every_register_is_where_its_table_says(model: str, protocol: int) -> None:
    table = find_table(model, protocol)
    block = block_of(table, "torque_enable", "present_temperature")
    assert block.size == table["present_temperature"].end - table["torque_enable"].address
    data = bytes((7 * k + 130) % 256 for k in range(block.size))
    (row,) = block.unpack(side_by_side([Status(1, 0, data)]))
    for name in block.dtype.names or ():
        register = table[name]
        if register.direction_bit is None:
            at = register.address - block.address
            assert int(row[name]) == register.decode(data[at : at + register.size]), name


def test_rows_are_in_the_order_of_the_answers() -> None:
    block = block_of(find_table("XM430-W350", 2), "present_position", "present_position")
    rows = block.unpack(side_by_side([Status(9, 0, b"\x01\0\0\0"), Status(3, 0, b"\xfe\xff\xff\xff")]))
    assert rows["present_position"].tolist() == [1, -2]


def test_blocks_are_alike_only_where_registers_are() -> None:
    tables = [find_table(model, 2) for model in ("XM430-W350", "XH540-W270", "XL430-W250")]
    same, too, other = (block_of(table, table.at(126).name, "present_position").layout for table in tables)  # type: ignore[union-attr]
    assert same == too
    assert same != other


def test_a_register_that_is_not_there_is_named() -> None:
    with refuses(HardwareError, "present_current"):
        block_of(find_table("XL430-W250", 2), "present_current", "present_position")
