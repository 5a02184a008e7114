"""Protocol 2.0: printed frames, stuffing, CRC; dynamixel-sdk where it is right."""

import itertools
from collections.abc import Callable
from typing import Any

import pytest
from dynamixel_sdk import Protocol2PacketHandler
from hypothesis import given, settings
from hypothesis import strategies as st

import more_frames
from hardware.dynamixel.codec import BROADCAST, STATUS, Status, fast_length, protocol2, valid_parts
from messages import refuses
from packet_vectors import FAST_BULK, FAST_BULK_REPLY, FAST_SYNC, FAST_SYNC_REPLY, TWO, SdkPort, Vector

HOT = st.lists(st.sampled_from((0xFF, 0xFD, 0x00, 0x55, 0xFE)), max_size=12).map(bytes)
PARTS = st.lists(
    st.builds(Status, st.integers(0, 252), st.integers(0, 255), HOT | st.binary(max_size=12)), min_size=1, max_size=8
)


def ends(sizes: list[int]) -> list[int]:
    """Bytes after which each part is whole."""
    return [fast_length(sizes[: count + 1]) for count in range(len(sizes))]


@pytest.mark.parametrize(("reply", "answers"), [(FAST_SYNC_REPLY, FAST_SYNC), (FAST_BULK_REPLY, FAST_BULK)])
def test_the_manuals_examples_cut_at_every_byte(reply: bytes, answers: tuple[Status, ...]) -> None:
    sizes = [len(answer.data) for answer in answers]
    assert fast_length(sizes) == len(reply)
    for length in range(len(reply) + 1):
        whole = sum(end <= length for end in ends(sizes))
        assert valid_parts(reply[:length], sizes) == list(answers[:whole])


@settings(max_examples=150)
@given(PARTS, st.data())
def test_any_reply_cut_or_damaged_yields_what_stands_before(answers: list[Status], data: st.DataObject) -> None:
    sizes, reply = [len(answer.data) for answer in answers], more_frames.fast_status(answers)
    assert valid_parts(reply + b"\xff\xff\xfd\0", sizes) == answers
    cut = data.draw(st.integers(0, len(reply)))
    assert valid_parts(reply[:cut], sizes) == answers[: sum(end <= cut for end in ends(sizes))]
    at = data.draw(st.integers(8, len(reply) - 1))
    damaged = reply[:at] + bytes((reply[at] ^ data.draw(st.integers(1, 255)),)) + reply[at + 1 :]
    assert valid_parts(damaged, sizes) == answers[: sum(end <= at for end in ends(sizes))]


def test_a_reply_to_another_question_has_no_parts() -> None:
    assert valid_parts(FAST_SYNC_REPLY, [4, 4]) == []
    assert valid_parts(FAST_SYNC_REPLY, [4, 4, 5]) == []
    assert valid_parts(FAST_SYNC_REPLY, [5, 4, 3]) == []  # same length, other layout
    assert valid_parts(protocol2.status(1, 0, b"\x01\x02\x03\x04"), [4]) == []
    assert valid_parts(protocol2.sync_read(132, 4, (3, 7, 4), fast=True), [4, 4, 4]) == []
    assert valid_parts(b"", [4]) == []


@pytest.mark.parametrize("vector", TWO, ids=lambda vector: vector.printed[:24].hex())
def test_frames_are_those_of_the_manual(vector: Vector) -> None:
    assert vector.built == vector.printed


def test_crc_is_umts_and_goes_on() -> None:
    assert more_frames.crc(b"123456789") == 0xFEE8
    assert more_frames.crc(b"6789", more_frames.crc(b"12345")) == 0xFEE8
    assert more_frames.crc(b"", 0x1234) == 0x1234


def test_stuffing_round_trips_for_every_short_string_of_hot_bytes() -> None:
    """Among them those from which the vendor's unstuffing loses a byte: FF FF FD FF FD FD."""
    for size in range(8):
        for body in map(bytes, itertools.product((0xFF, 0xFD, 0x00, 0x55), repeat=size)):
            stuffed = protocol2.stuff(body)
            assert protocol2.unstuff(stuffed) == body
            assert protocol2.HEADER not in stuffed


WRONG: dict[str, Callable[[], bytes]] = {
    "id FD": lambda: protocol2.ping(0xFD),
    "id FF": lambda: protocol2.ping(0xFF),
    "negative id": lambda: protocol2.ping(-1),
    "address": lambda: protocol2.sync_read(65536, 1, [1]),
    "negative address": lambda: protocol2.write(1, -1, b""),
    "length": lambda: protocol2.sync_read(0, 65536, [1]),
    "group id": lambda: protocol2.sync_read(0, 1, [1, BROADCAST]),
    "group id FD": lambda: protocol2.sync_write(0, 1, [(0xFD, b"\0")]),
    "short data": lambda: protocol2.sync_write(0, 2, [(1, b"\0")]),
    "long data": lambda: protocol2.sync_write(0, 2, [(1, b"\0\0\0")]),
    "huge frame": lambda: protocol2.write(1, 0, bytes(protocol2.MAX_LENGTH)),
    "huge when stuffed": lambda: protocol2.write(1, 0, b"\xff\xff\xfd" * (protocol2.MAX_LENGTH // 4)),
}


@pytest.mark.parametrize("build", WRONG.values(), ids=WRONG.keys())
def test_what_cannot_be_sent_is_refused(build: Callable[[], bytes]) -> None:
    with refuses(ValueError):
        build()


def sdk_frame(device: int, code: int, params: bytes) -> bytes:
    length = len(params) + 3
    packet: list[Any] = [0, 0, 0, 0, device, length & 0xFF, length >> 8, code, *params, 0, 0]
    port = SdkPort()
    assert Protocol2PacketHandler().txPacket(port, packet) == 0
    return port.sent


@given(
    st.integers(0, 252), st.integers(0, 255), st.binary(max_size=60).filter(lambda data: b"\xff\xff\xfd" not in data)
)
def test_frames_equal_those_of_the_sdk_where_nothing_is_stuffed(device: int, code: int, params: bytes) -> None:
    if b"\xff\xff\xfd" not in bytes((code,)) + params:
        assert protocol2.frame(device, code, params) == sdk_frame(device, code, params)


@given(st.integers(0, 252), st.integers(0, 255), st.binary(max_size=30).filter(lambda data: b"\xff\xfd" not in data))
def test_the_sdk_understands_our_statuses(device: int, error: int, data: bytes) -> None:
    port = SdkPort(protocol2.status(device, error, data))
    packet, result = Protocol2PacketHandler().rxPacket(port, False)
    assert result == 0
    assert (packet[4], packet[7], packet[8], bytes(packet[9:-2])) == (device, STATUS, error, data)
