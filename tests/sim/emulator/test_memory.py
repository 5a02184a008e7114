"""The memory of an emulated device: access, holes, indirect addressing."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulated import read_register, servo2, write_register
from hardware.dynamixel.codec import Error2
from hardware.dynamixel.control_table import find_table
from sim.emulator.memory import Memory


@pytest.mark.parametrize(("model", "first"), [("XM430-W350", 1), ("XM430-W350", 29), ("XL330-M288", 1)])
def test_indirect_data_stand_for_what_they_point_at(model: str, first: int) -> None:
    servo = servo2(model)
    for offset in range(4):
        assert write_register(servo, f"indirect_address_{first + offset}", 116 + offset) == 0
    assert write_register(servo, f"indirect_address_{first + 4}", 132) == 0
    data = servo.table[f"indirect_data_{first}"].address
    servo.write(data, (2100).to_bytes(4, "little"), 0.0)
    assert read_register(servo, "goal_position") == 2100
    assert servo.read(data, 5, 0.0).data == (2100).to_bytes(4, "little") + b"\0"  # low byte of 2048
    write_register(servo, "torque_enable", 1)
    assert servo.read(data + 4, 1, 3.0).data == (2100 & 0xFF).to_bytes(1, "little")
    assert servo.change(data, (4096).to_bytes(4, "little"), 3.0) == Error2.DATA_LIMIT
    assert servo.change(data, bytes(2), 3.0) == Error2.DATA_LENGTH
    assert servo.change(data + 4, bytes(1), 3.0) == Error2.ACCESS


@settings(max_examples=30, deadline=None)
@given(data=st.binary(min_size=1, max_size=28))
def test_indirect_data_that_point_at_themselves_are_storage(data: bytes) -> None:
    servo = servo2()
    assert servo.change(224, data, 0.0) == 0
    assert servo.read(224, len(data), 0.0).data == data


@settings(max_examples=60, deadline=None)
@given(address=st.integers(0, 700), length=st.integers(0, 700))
def test_what_is_readable_has_its_length(address: int, length: int) -> None:
    memory = Memory(find_table("XL330-M288", 2))
    if memory.readable(address, length):
        assert len(memory.slice(address, length)) == length
        assert any(memory.table.at(place) for place in range(address, address + length))
    else:
        inside = length > 0 and address + length <= memory.table.size
        assert not inside or not any(memory.table.at(place) for place in range(address, address + length))
