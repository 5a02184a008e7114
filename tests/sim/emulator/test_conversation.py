"""Replies of devices: addresses, order, gaps, fast replies, two devices of one id, damaged instructions."""

import random
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import more_frames
from emulated import servo1, servo2
from hardware.dynamixel.codec import (
    ALERT,
    BROADCAST,
    Error1,
    Error2,
    Frame,
    Instruction,
    Status,
    protocol1,
    protocol2,
    valid_parts,
)
from sim.emulator.conversation import (
    Conversation,
    Gaps,
    ReadItem,
    Reply,
    WriteItem,
    damage_answer,
    damaged_address,
    reads1,
    reads2,
    writes1,
    writes2,
)
from sim.emulator.faults import Fault, FaultKind
from sim.emulator.line import Line, Timing
from stub_devices import StubDevice


def _said(data: bytes, devices: Sequence[StubDevice], gaps: Gaps = Gaps.SILENCE, **more: object) -> list[Reply]:
    parser = protocol2.parser() if devices[0].protocol == 2 else protocol1.parser()
    (frame,) = parser.feed(data)
    silent = more.get("silent", ())
    assert isinstance(silent, tuple)
    return Conversation(gaps=gaps).answers(frame, devices, 1.0, silent=silent)


def _row(*ids: int, protocol: int = 2) -> list[StubDevice]:
    devices = [StubDevice(id=device, protocol=protocol) for device in ids]
    for device in devices:
        device.store[132:136] = bytes((device.id, 0, 0, 0))
    return devices


def _who(replies: Sequence[Reply]) -> list[int]:
    return [reply.id for reply in replies]


def test_an_address_reaches_its_device_and_all_receive_it() -> None:
    devices = _row(1, 2, 3)
    (reply,) = _said(protocol2.ping(2), devices)
    assert reply.data == protocol2.status(2, 0, b"\x06\x04\x26")
    assert [len(device.done) for device in devices] == [0, 1, 0]
    assert [device.heard for device in devices] == [[1.0]] * 3


def test_a_broadcast_ping_is_answered_in_order_of_ids() -> None:
    assert _who(_said(protocol2.ping(0xFE), _row(7, 3, 5))) == [3, 5, 7]


def test_other_broadcasts_are_obeyed_in_silence() -> None:
    devices = _row(1, 2)
    assert _said(protocol2.write(0xFE, 64, b"\x01"), devices) == []
    assert [device.store[64] for device in devices] == [1, 1]
    assert _said(more_frames.reboot(0xFE), devices) == []
    assert [device.done[-1] for device in devices] == [(Instruction.REBOOT, b"", True, False)] * 2


def test_a_secondary_id_is_obeyed_in_silence() -> None:
    devices = _row(1, 2, 3)
    devices[1].secondary_id = devices[2].secondary_id = 0
    assert _said(protocol2.write(0, 64, b"\x01"), devices) == []
    assert [device.store[64] for device in devices] == [0, 1, 1]
    assert devices[1].done[-1][3]
    assert _said(protocol2.sync_write(65, 1, [(0, b"\x05"), (1, b"\x06")]), devices) == []
    assert [device.store[65] for device in devices] == [6, 5, 5]


def test_group_reads_are_answered_in_the_order_of_the_frame() -> None:
    for request in (protocol2.sync_read(132, 4, [3, 1, 2]), more_frames.bulk_read([(d, 132, 4) for d in (3, 1, 2)])):
        replies = _said(request, _row(1, 2, 3))
        assert [reply.data for reply in replies] == [protocol2.status(d, 0, bytes((d, 0, 0, 0))) for d in (3, 1, 2)]


def test_a_missing_device_silences_those_behind_it_or_is_skipped() -> None:
    request = protocol2.sync_read(132, 4, [1, 9, 2])
    assert _who(_said(request, _row(1, 2))) == [1]
    assert _who(_said(request, _row(1, 2), Gaps.SKIP)) == [1, 2]


def test_a_device_that_answers_no_reads_is_a_gap() -> None:
    devices = _row(1, 2, 3)
    devices[1].answers_reads = False
    assert _who(_said(protocol2.sync_read(132, 4, [1, 2, 3]), devices)) == [1]


def test_an_id_counts_once_in_a_bulk_read() -> None:
    request = more_frames.bulk_read([(1, 132, 4), (1, 126, 2), (2, 132, 4)])
    assert _who(_said(request, _row(1, 2))) == [1]
    assert _who(_said(request, _row(1, 2), Gaps.SKIP)) == [1, 2]


def test_a_silent_tail_is_silent_in_group_reads_only() -> None:
    devices = _row(1, 2, 3)
    assert _who(_said(protocol2.sync_read(132, 4, [1, 2, 3]), devices, silent=(2,))) == [1]
    assert _who(_said(protocol2.ping(2), devices, silent=(2,))) == [2]


def test_a_refused_part_has_its_error_and_no_data() -> None:
    replies = _said(protocol2.sync_read(2000, 4, [1, 2]), _row(1, 2))
    assert [reply.data for reply in replies] == [protocol2.status(1, 7), protocol2.status(2, 7)]


def test_the_fast_reply_of_the_manual() -> None:
    devices = _row(3, 4, 7)
    for device, value in zip(devices, (166, 1023, 2079), strict=True):
        device.store[132:136] = value.to_bytes(4, "little")
    replies = _said(protocol2.sync_read(132, 4, [3, 7, 4], fast=True), devices)
    expected = "FFFFFD00FE1900550003A6000000840800071F08000016CA0004FF030000D19E"
    assert b"".join(part.data for part in replies) == bytes.fromhex(expected)
    assert [reply.return_delay for reply in replies] == [0.0, None, None]


def test_a_fast_reply_is_cut_short_by_a_gap() -> None:
    request = protocol2.sync_read(132, 4, [1, 9, 2], fast=True)
    reply = b"".join(part.data for part in _said(request, _row(1, 2)))
    assert valid_parts(reply, [4, 4, 4]) == [Status(1, 0, b"\x01\0\0\0")]
    assert _said(protocol2.sync_read(132, 4, [9, 1], fast=True), _row(1, 2)) == []
    reply = b"".join(part.data for part in _said(request, _row(1, 2), Gaps.SKIP))
    assert len(reply) == 8 + 2 * 8


def test_a_device_without_fast_reads_is_a_gap_in_them_alone() -> None:
    devices = _row(1, 2)
    devices[1].fast_read = False
    assert _who(_said(protocol2.sync_read(132, 4, [1, 2], fast=True), devices)) == [1]
    assert _who(_said(protocol2.sync_read(132, 4, [1, 2]), devices)) == [1, 2]


def test_a_fast_bulk_read_has_parts_of_their_own_length() -> None:
    devices = _row(1, 2)
    devices[0].store[126:128] = b"\xff\xff"
    replies = _said(more_frames.bulk_read([(1, 126, 2), (2, 132, 4)], fast=True), devices)
    reply = b"".join(part.data for part in replies)
    assert valid_parts(reply, [2, 4]) == [Status(1, 0, b"\xff\xff"), Status(2, 0, b"\x02\0\0\0")]


def test_two_devices_of_one_id_are_not_understood() -> None:
    (reply,) = _said(protocol2.ping(1), _row(1, 1))
    assert protocol2.parser().feed(reply.data) == []
    (again,) = _said(protocol2.ping(1), _row(1, 1))
    assert again == reply
    (frame,) = protocol2.parser().feed(protocol2.ping(1))
    (other,) = Conversation(noise=random.Random(1)).answers(frame, _row(1, 1), 1.0)
    assert other.data != reply.data
    parts = b"".join(part.data for part in _said(protocol2.sync_read(132, 4, [1, 2], fast=True), _row(1, 1, 2)))
    assert valid_parts(parts, [4, 4]) == []


def test_a_status_frame_is_no_instruction() -> None:
    devices = _row(1)
    assert _said(protocol2.status(1, 0), devices) == []
    assert devices[0].done == []


def test_protocol_1_has_bulk_read_and_sync_write() -> None:
    devices = _row(1, 2, protocol=1)
    devices[1].store[36] = 9
    replies = _said(protocol1.bulk_read([(2, 36, 2), (1, 36, 1)]), devices)
    assert [reply.data for reply in replies] == [protocol1.status(2, 0, b"\x09\0"), protocol1.status(1, 0, b"\0")]
    assert _said(protocol1.sync_write(30, 1, [(1, b"\x07")]), devices) == []
    assert devices[0].store[30] == 7


def test_an_ax_knows_no_bulk_read() -> None:
    devices = _row(1, 2, protocol=1)
    devices[1].model = "AX-12A"
    assert _who(_said(protocol1.bulk_read([(1, 36, 2), (2, 36, 2)]), devices)) == [1]


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
@given(protocol=st.sampled_from((1, 2)), data=st.binary(max_size=12))
def test_any_bytes_are_accepted(protocol: int, data: bytes) -> None:
    header = PROTOCOLS[protocol].HEADER
    for received in (data, header + data):
        found = damaged_address(protocol, received)
        assert found is None or header + bytes((found,)) in received


@pytest.mark.parametrize("protocol", [1, 2])
def test_a_frame_that_is_not_whole_is_none(protocol: int) -> None:
    frame = _spoilt(PROTOCOLS[protocol].ping(7))
    assert damaged_address(protocol, frame) == 7
    for length in range(len(frame)):
        assert damaged_address(protocol, frame[:length]) is None
    assert damaged_address(protocol, frame + b"\0") is None


def test_behind_a_frame_that_broke_off_the_last_one_counts() -> None:
    assert damaged_address(2, protocol2.ping(5)[:9] + _spoilt(protocol2.ping(7))) == 7


def test_an_answer_to_damage_has_the_present_errors() -> None:
    new, old = servo2(), servo1()
    assert damage_answer(new, 0.0) == (Error2.CRC, b"") and damage_answer(old, 0.0) == (Error1.CHECKSUM, b"")
    new.heat(90.0, 1.0)
    old.heat(90.0, 1.0)
    assert damage_answer(new, 1.0) == (ALERT | Error2.CRC, b"")
    assert damage_answer(old, 1.0) == (Error1.OVERHEATING | Error1.CHECKSUM, b"")
    for servo, level in ((new, 68), (old, 16)):
        servo.write(level, b"\0", 1.0)
        assert damage_answer(servo, 1.0) is None


def _line(*devices: StubDevice, answers_damage: bool = True) -> Line:
    return Line(devices, timing=Timing.none(), answers_damage=answers_damage)


def _ask(line: Line, data: bytes, now: float = 0.0) -> bytes:
    line.receive(data, now)
    return line.take(1e9)


@pytest.mark.parametrize(("protocol", "error"), [(1, Error1.CHECKSUM), (2, Error2.CRC)])
def test_a_line_answers_damage_only_where_it_is_set_to(protocol: int, error: int) -> None:
    words = PROTOCOLS[protocol]
    devices = [StubDevice(id=number, protocol=protocol) for number in (1, 2)]
    frame = _spoilt(words.write(2, 30, b"\x07"))
    assert _ask(_line(*devices, answers_damage=False), frame) == b""
    line = _line(*devices)
    assert _ask(line, frame) == words.status(2, error)
    assert devices[1].store[30] == 0 and devices[1].heard == []  # neither obeyed nor a life sign
    assert _ask(line, words.write(2, 30, b"\x07"), 1.0) == words.status(2) and devices[1].store[30] == 7
    assert _ask(line, _spoilt(words.write(BROADCAST, 30, b"\x08")), 2.0) == b""
    assert _ask(line, _spoilt(words.ping(9)), 3.0) == b""


def test_a_device_that_is_missing_starts_or_has_another_speed_does_not_answer() -> None:
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
        line.receive(bytes((byte,)), 0.0)
    assert line.take(1e9) == b""
    line.receive(frame[-1:], 0.0)
    assert line.take(1e9) == protocol2.status(1, Error2.CRC)
    assert _ask(line, protocol2.ping(1), 1.0) == protocol2.status(1, 0, b"\x06\x04\x26")


IDS = st.integers(0, 252)
WORDS = st.integers(0, 0xFFFF)


def _frame2(data: bytes) -> Frame:
    (frame,) = protocol2.parser().feed(data)
    return frame


@settings(max_examples=50)
@given(WORDS, WORDS, st.lists(IDS, max_size=40), st.booleans())
def test_a_sync_read_asks_each_id_for_the_same(address: int, length: int, ids: list[int], fast: bool) -> None:
    frame = _frame2(protocol2.sync_read(address, length, ids, fast=fast))
    assert list(reads2(frame.code, frame.params)) == [ReadItem(device, address, length) for device in ids]


@settings(max_examples=50)
@given(st.lists(st.tuples(IDS, WORDS, WORDS), max_size=40), st.booleans())
def test_a_bulk_read_asks_each_id_for_its_own(items: list[tuple[int, int, int]], fast: bool) -> None:
    frame = _frame2(more_frames.bulk_read(items, fast=fast))
    assert list(reads2(frame.code, frame.params)) == items


@settings(max_examples=50)
@given(st.lists(st.tuples(IDS, WORDS, st.binary(max_size=12)), max_size=20))
def test_a_bulk_write_gives_each_id_its_own(items: list[tuple[int, int, bytes]]) -> None:
    frame = _frame2(more_frames.bulk_write(items))
    assert writes2(frame.code, frame.params) == items


def test_sync_writes_of_both_protocols() -> None:
    items = [(1, b"\x96\0\0\0"), (2, b"\xaa\0\0\0")]
    frame = _frame2(protocol2.sync_write(116, 4, items))
    assert writes2(frame.code, frame.params) == [WriteItem(device, 116, data) for device, data in items]
    (frame,) = protocol1.parser().feed(protocol1.sync_write(30, 4, items))
    assert writes1(frame.params) == [WriteItem(device, 30, data) for device, data in items]


def test_a_bulk_read_of_protocol_1() -> None:
    (frame,) = protocol1.parser().feed(protocol1.bulk_read([(1, 30, 2), (2, 36, 2)]))
    assert list(reads1(frame.params)) == [ReadItem(1, 30, 2), ReadItem(2, 36, 2)]


@settings(max_examples=100)
@given(st.binary(max_size=30))
def test_any_parameters_are_read_without_an_error(params: bytes) -> None:
    for code in Instruction:
        for item in writes2(code, params):
            assert len(item.data) <= len(params)
        reads2(code, params)
    reads1(params)
    writes1(params)


def test_a_truncated_part_addresses_no_device() -> None:
    whole = _frame2(more_frames.bulk_write([(1, 32, b"\xa0\0"), (2, 31, b"P")])).params
    assert writes2(Instruction.BULK_WRITE, whole[:-1]) == [WriteItem(1, 32, b"\xa0\0")]
    assert writes2(Instruction.SYNC_WRITE, b"\x74\0\x04\0\x01\x96\0\0") == []
    assert not reads2(Instruction.BULK_READ, b"\x01\x90\0\x02")
