"""Registers: bytes <-> counts."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.dynamixel.register import Register
from support.messages import refuses


def _register(*, size: int = 2, signed: bool = False, direction_bit: int | None = None) -> Register:
    return Register("some", 10, size, signed, True, None, None, None, None, None, direction_bit)


REGISTERS = [_register(size=size, signed=signed) for size in (1, 2, 4) for signed in (False, True)]
SPEED = _register(signed=True, direction_bit=10)


@pytest.mark.parametrize(
    ("register", "counts", "data"),
    [
        (_register(size=4, signed=True), -1, "ffffffff"),
        (_register(size=4, signed=True), -131073, "fffffdff"),
        (_register(size=2), 65535, "ffff"),
        (_register(size=2, signed=True), -2, "feff"),
        (_register(size=1, signed=True), -1, "ff"),
        (SPEED, 300, "2c01"),
        (SPEED, -300, "2c05"),
        (SPEED, -1023, "ff07"),
        (SPEED, 0, "0000"),
    ],
)
def test_bytes_are_known(register: Register, counts: int, data: str) -> None:
    assert register.encode(counts).hex() == data
    assert register.decode(bytes.fromhex(data)) == counts


def test_clockwise_zero_is_zero() -> None:
    assert SPEED.decode(bytes.fromhex("0004")) == 0


@settings(max_examples=100)
@given(register=st.sampled_from([*REGISTERS, SPEED]), data=st.data())
def test_every_count_survives_the_wire(register: Register, data: st.DataObject) -> None:
    counts = data.draw(st.integers(register.narrowest, register.widest))
    assert register.decode(register.encode(counts)) == counts


@settings(max_examples=100)
@given(register=st.sampled_from([*REGISTERS, SPEED]), data=st.data())
def test_every_byte_string_has_a_count_within_the_width(register: Register, data: st.DataObject) -> None:
    raw = data.draw(st.binary(min_size=register.size, max_size=register.size))
    assert register.narrowest <= register.decode(raw) <= register.widest


@pytest.mark.parametrize("register", [*REGISTERS, SPEED])
def test_counts_beyond_the_width_are_refused(register: Register) -> None:
    for counts in (register.narrowest - 1, register.widest + 1):
        with refuses(ValueError):
            register.encode(counts)


def test_data_of_another_length_are_refused() -> None:
    for data in (b"", b"\x00", bytes(3)):
        with refuses(ValueError, 2):
            _register().decode(data)


def test_limits_bound_what_may_be_written() -> None:
    bounded = Register("some", 0, 2, True, True, None, None, -5, 9, 0)
    assert [counts for counts in range(-20, 20) if bounded.allows(counts)] == list(range(-5, 10))
    assert _register().allows(10**9)
    assert bounded.end == 2
