"""Damaged instructions: whom they were for, and what is said of them."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulated import servo1, servo2
from hardware.dynamixel import protocol1, protocol2
from hardware.dynamixel.packets import ALERT, BROADCAST, Error1, Error2
from sim.emulator.damage import complaint, damaged_address
from sim.emulator.faults import Fault, FaultKind
from sim.emulator.line import Line
from sim.emulator.wire import Timing
from stub_devices import StubDevice

PROTOCOLS = {2: protocol2, 1: protocol1}


def _spoilt(frame: bytes, at: int = -1) -> bytes:
    spoilt = bytearray(frame)
    spoilt[at] ^= 0x01
    return bytes(spoilt)


@settings(max_examples=100)
@given(
    protocol=st.sampled_from((1, 2)),
    own=st.integers(0, 252),
    data=st.binary(min_size=1, max_size=12),
    bit=st.integers(0, 7),
    place=st.integers(0, 11),
)
def test_one_changed_bit_behind_the_length_is_noticed(
    protocol: int, own: int, data: bytes, bit: int, place: int
) -> None:
    frame = bytearray(PROTOCOLS[protocol].write(own, 30, data))
    assert damaged_address(protocol, bytes(frame)) is None
    frame[len(frame) - 1 - place % len(data)] ^= 1 << bit
    spoilt = bytes(frame)
    if spoilt.count(PROTOCOLS[protocol].HEADER) == 1:  # a header inside begins another frame
        assert damaged_address(protocol, spoilt) == own
        assert damaged_address(protocol, b"\x00\x31" + spoilt) == own


@settings(max_examples=100)
@given(protocol=st.sampled_from((1, 2)), heard=st.binary(max_size=12))
def test_any_bytes_are_borne(protocol: int, heard: bytes) -> None:
    header = PROTOCOLS[protocol].HEADER
    for said in (heard, header + heard):
        found = damaged_address(protocol, said)
        assert found is None or header + bytes((found,)) in said


@pytest.mark.parametrize("protocol", [1, 2])
def test_a_frame_that_is_not_whole_is_none(protocol: int) -> None:
    frame = _spoilt(PROTOCOLS[protocol].ping(7))
    assert damaged_address(protocol, frame) == 7
    for length in range(len(frame)):
        assert damaged_address(protocol, frame[:length]) is None
    assert damaged_address(protocol, frame + b"\0") is None


def test_behind_a_frame_that_broke_off_the_last_one_counts() -> None:
    assert damaged_address(2, protocol2.ping(5)[:9] + _spoilt(protocol2.ping(7))) == 7


def test_what_is_said_has_the_errors_that_stand() -> None:
    new, old = servo2(), servo1()
    assert complaint(new, 0.0) == (Error2.CRC, b"") and complaint(old, 0.0) == (Error1.CHECKSUM, b"")
    new.heat(90.0, 1.0)
    old.heat(90.0, 1.0)
    assert complaint(new, 1.0) == (ALERT | Error2.CRC, b"")
    assert complaint(old, 1.0) == (Error1.OVERHEATING | Error1.CHECKSUM, b"")
    for servo, level in ((new, 68), (old, 16)):
        servo.write(level, b"\0", 1.0)
        assert complaint(servo, 1.0) is None


def _line(*devices: StubDevice, answers_damage: bool = True) -> Line:
    return Line(devices, timing=Timing.none(), answers_damage=answers_damage)


def _ask(line: Line, data: bytes, now: float = 0.0) -> bytes:
    line.hear(data, now)
    return line.take(1e9)


@pytest.mark.parametrize(("protocol", "error"), [(1, Error1.CHECKSUM), (2, Error2.CRC)])
def test_a_line_answers_damage_only_where_it_is_told_to(protocol: int, error: int) -> None:
    words = PROTOCOLS[protocol]
    devices = [StubDevice(id=number, protocol=protocol) for number in (1, 2)]
    frame = _spoilt(words.write(2, 30, b"\x07"))
    assert _ask(_line(*devices, answers_damage=False), frame) == b""
    line = _line(*devices)
    assert _ask(line, frame) == words.status(2, error)
    assert devices[1].memory[30] == 0 and devices[1].heard == []  # neither obeyed nor a life sign
    assert _ask(line, words.write(2, 30, b"\x07"), 1.0) == words.status(2) and devices[1].memory[30] == 7
    assert _ask(line, _spoilt(words.write(BROADCAST, 30, b"\x08")), 2.0) == b""
    assert _ask(line, _spoilt(words.ping(9)), 3.0) == b""


def test_who_is_missing_starts_or_has_another_speed_says_nothing() -> None:
    frame = _spoilt(protocol2.ping(1))
    deaf = (StubDevice(boots=True), StubDevice(baud=1_000_000), StubDevice(id=2))
    assert [_ask(_line(device), frame) for device in deaf] == [b"", b"", b""]
    line = _line(StubDevice())
    line.faults.add(Fault(FaultKind.MISSING, ids=(1,)), 0.0)
    assert _ask(line, frame) == b""
    line.faults.clear(1.0)
    assert _ask(line, frame, 1.0) == protocol2.status(1, Error2.CRC)


def test_a_damaged_frame_in_pieces_is_answered_once() -> None:
    line = _line(StubDevice())
    frame = _spoilt(protocol2.ping(1))
    for byte in frame[:-1]:
        line.hear(bytes((byte,)), 0.0)
    assert line.take(1e9) == b""
    line.hear(frame[-1:], 0.0)
    assert line.take(1e9) == protocol2.status(1, Error2.CRC)
    assert _ask(line, protocol2.ping(1), 1.0) == protocol2.status(1, 0, b"\x06\x04\x26")
