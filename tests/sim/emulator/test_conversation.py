"""Replies of devices: addresses, order, gaps, fast replies, two devices of one id, damaged instructions."""

import random
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import more_frames
from hardware.dynamixel.codec import (
    BROADCAST,
    Instruction,
    protocol1,
    protocol2,
)
from sim.emulator.conversation import (
    Conduct,
    Conversation,
    Gaps,
    ReadItem,
    Reply,
    WriteItem,
    reads1,
    reads2,
    writes1,
    writes2,
)
from stub_devices import StubDevice

PROTOCOLS = {2: protocol2, 1: protocol1}


def _said(
    data: bytes, devices: Sequence[StubDevice], gaps: Gaps = Gaps.SILENCE, silent: tuple[int, ...] = (), seed: int = 0
) -> list[Reply]:
    (frame,) = PROTOCOLS[devices[0].protocol].parser().feed(data)
    return Conversation(conduct=Conduct(gaps=gaps), noise=random.Random(seed)).answers(
        frame, devices, 1.0, silent=silent
    )


def _row(*ids: int, protocol: int = 2) -> list[StubDevice]:
    devices = [StubDevice(id=device, protocol=protocol) for device in ids]
    for device in devices:
        device.store[132:136] = bytes((device.id, 0, 0, 0))
    return devices


def _who(replies: Sequence[Reply]) -> list[int]:
    return [reply.id for reply in replies]


def _joined(replies: Sequence[Reply]) -> bytes:
    return b"".join(reply.data for reply in replies)


def test_a_broadcast_ping_is_answered_in_order_of_ids_and_the_rest_is_obeyed_in_silence() -> None:
    assert _who(_said(protocol2.ping(BROADCAST), _row(7, 3, 5))) == [3, 5, 7]
    devices = _row(1, 2)
    assert _said(protocol2.write(BROADCAST, 64, b"\x01"), devices) == []
    assert [device.store[64] for device in devices] == [1, 1]
    assert _said(more_frames.reboot(BROADCAST), devices) == []
    assert [device.done[-1] for device in devices] == [(Instruction.REBOOT, b"", True, False)] * 2


@pytest.mark.parametrize(
    ("request_", "ids"),
    [
        (protocol2.sync_read(132, 4, [1, 9, 2]), (1, 2)),  # 9 is missing
        (protocol2.sync_read(132, 4, [1, 3, 2]), (1, 2, 3)),  # 3 is silent in group reads
        (more_frames.bulk_read([(1, 132, 4), (1, 126, 2), (2, 132, 4)]), (1, 2)),  # an id counts once
        (protocol2.sync_read(132, 4, [1, 9, 2], fast=True), (1, 2)),
    ],
)
def test_a_gap_silences_those_behind_it_or_is_skipped(request_: bytes, ids: tuple[int, ...]) -> None:
    assert _who(_said(request_, _row(*ids), silent=(3,))) == [1]
    assert _who(_said(request_, _row(*ids), Gaps.SKIP, silent=(3,))) == [1, 2]
    assert _who(_said(protocol2.ping(ids[-1]), _row(*ids), silent=(3,))) == [ids[-1]]


def test_the_fast_reply_of_the_manual() -> None:
    devices = _row(3, 4, 7)
    for device, value in zip(devices, (166, 1023, 2079), strict=True):
        device.store[132:136] = value.to_bytes(4, "little")
    replies = _said(protocol2.sync_read(132, 4, [3, 7, 4], fast=True), devices)
    expected = "FFFFFD00FE1900550003A6000000840800071F08000016CA0004FF030000D19E"
    assert _joined(replies) == bytes.fromhex(expected)
    assert [reply.return_delay for reply in replies] == [0.0, None, None]


def test_protocol_1_has_bulk_read_and_sync_write() -> None:
    devices = _row(1, 2, protocol=1)
    devices[1].store[36] = 9
    request = protocol1.bulk_read([(2, 36, 2), (1, 36, 1)])
    assert _joined(_said(request, devices)) == protocol1.status(2, 0, b"\x09\0") + protocol1.status(1, 0, b"\0")
    assert _said(protocol1.sync_write(30, 1, [(1, b"\x07")]), devices) == [] and devices[0].store[30] == 7
    devices[0].model = "AX-12A"  # knows no bulk read
    assert _who(_said(request, devices)) == [2]


IDS = st.integers(0, 252)
WORDS = st.integers(0, 0xFFFF)


def _params(data: bytes, protocol: int = 2) -> tuple[int, bytes]:
    (frame,) = PROTOCOLS[protocol].parser().feed(data)
    return frame.code, frame.params


@settings(max_examples=50)
@given(st.lists(st.tuples(IDS, WORDS, WORDS), max_size=40), WORDS, WORDS, st.booleans())
def test_group_reads_are_read_from_the_bytes(
    items: list[tuple[int, int, int]], address: int, length: int, fast: bool
) -> None:
    ids = [device for device, _, _ in items]
    sync = _params(protocol2.sync_read(address, length, ids, fast=fast))
    assert list(reads2(*sync)) == [ReadItem(device, address, length) for device in ids]
    assert list(reads2(*_params(more_frames.bulk_read(items, fast=fast)))) == items
    _, first = _params(protocol1.bulk_read([(1, 30, 2), (2, 36, 2)]), 1)
    assert list(reads1(first)) == [ReadItem(1, 30, 2), ReadItem(2, 36, 2)]


@settings(max_examples=50)
@given(st.lists(st.tuples(IDS, WORDS, st.binary(max_size=12)), max_size=20))
def test_group_writes_are_read_from_the_bytes(items: list[tuple[int, int, bytes]]) -> None:
    assert writes2(*_params(more_frames.bulk_write(items))) == items
    same = [(device, data[:4].ljust(4, b"\0")) for device, _, data in items]
    assert writes2(*_params(protocol2.sync_write(116, 4, same))) == [WriteItem(own, 116, data) for own, data in same]
    _, first = _params(protocol1.sync_write(30, 4, same), 1)
    assert writes1(first) == [WriteItem(own, 30, data) for own, data in same]


@settings(max_examples=100)
@given(st.binary(max_size=30))
def test_any_parameters_are_read_without_an_error(params: bytes) -> None:
    for code in Instruction:
        for item in writes2(code, params):
            assert len(item.data) <= len(params)
        reads2(code, params)
    reads1(params)
    writes1(params)
