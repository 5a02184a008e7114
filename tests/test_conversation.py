"""Who answers what: addresses, order, gaps, fast replies, two devices of one id."""

import random
from collections.abc import Sequence

from hardware.dynamixel import protocol1, protocol2
from hardware.dynamixel.fast_status import sound_parts
from hardware.dynamixel.packets import Instruction, Status
from hardware.dynamixel.parsers import parser1, parser2
from sim.emulator.conversation import Conversation, Gaps, Spoken
from stub_devices import StubDevice


def _said(data: bytes, devices: Sequence[StubDevice], gaps: Gaps = Gaps.SILENCE, **more: object) -> list[Spoken]:
    parser = parser2() if devices[0].protocol == 2 else parser1()
    (frame,) = parser.feed(data)
    cut = more.get("cut", ())
    assert isinstance(cut, tuple)
    return Conversation(gaps=gaps).answers(frame, devices, 1.0, cut=cut)


def _row(*ids: int, protocol: int = 2) -> list[StubDevice]:
    devices = [StubDevice(id=device, protocol=protocol) for device in ids]
    for device in devices:
        device.memory[132:136] = bytes((device.id, 0, 0, 0))
    return devices


def _who(said: Sequence[Spoken]) -> list[int]:
    return [spoken.id for spoken in said]


def test_an_address_reaches_its_device_and_all_hear_it() -> None:
    devices = _row(1, 2, 3)
    (spoken,) = _said(protocol2.ping(2), devices)
    assert spoken.data == protocol2.status(2, 0, b"\x06\x04\x26")
    assert [len(device.done) for device in devices] == [0, 1, 0]
    assert [device.heard for device in devices] == [[1.0]] * 3


def test_a_broadcast_ping_is_answered_in_order_of_ids() -> None:
    assert _who(_said(protocol2.ping(0xFE), _row(7, 3, 5))) == [3, 5, 7]


def test_other_broadcasts_are_obeyed_in_silence() -> None:
    devices = _row(1, 2)
    assert _said(protocol2.write(0xFE, 64, b"\x01"), devices) == []
    assert [device.memory[64] for device in devices] == [1, 1]
    assert _said(protocol2.reboot(0xFE), devices) == []
    assert [device.done[-1] for device in devices] == [(Instruction.REBOOT, b"", True, False)] * 2


def test_a_secondary_id_is_obeyed_in_silence() -> None:
    devices = _row(1, 2, 3)
    devices[1].secondary_id = devices[2].secondary_id = 0
    assert _said(protocol2.write(0, 64, b"\x01"), devices) == []
    assert [device.memory[64] for device in devices] == [0, 1, 1]
    assert devices[1].done[-1][3]
    assert _said(protocol2.sync_write(65, 1, [(0, b"\x05"), (1, b"\x06")]), devices) == []
    assert [device.memory[65] for device in devices] == [6, 5, 5]


def test_group_reads_are_answered_in_the_order_of_the_frame() -> None:
    for request in (protocol2.sync_read(132, 4, [3, 1, 2]), protocol2.bulk_read([(d, 132, 4) for d in (3, 1, 2)])):
        said = _said(request, _row(1, 2, 3))
        assert [spoken.data for spoken in said] == [protocol2.status(d, 0, bytes((d, 0, 0, 0))) for d in (3, 1, 2)]


def test_a_missing_device_silences_those_behind_it_or_is_skipped() -> None:
    request = protocol2.sync_read(132, 4, [1, 9, 2])
    assert _who(_said(request, _row(1, 2))) == [1]
    assert _who(_said(request, _row(1, 2), Gaps.SKIP)) == [1, 2]


def test_a_device_that_answers_no_reads_is_a_gap() -> None:
    devices = _row(1, 2, 3)
    devices[1].answers_reads = False
    assert _who(_said(protocol2.sync_read(132, 4, [1, 2, 3]), devices)) == [1]


def test_an_id_counts_once_in_a_bulk_read() -> None:
    request = protocol2.bulk_read([(1, 132, 4), (1, 126, 2), (2, 132, 4)])
    assert _who(_said(request, _row(1, 2))) == [1]
    assert _who(_said(request, _row(1, 2), Gaps.SKIP)) == [1, 2]


def test_a_cut_tail_is_silent_in_group_reads_only() -> None:
    devices = _row(1, 2, 3)
    assert _who(_said(protocol2.sync_read(132, 4, [1, 2, 3]), devices, cut=(2,))) == [1]
    assert _who(_said(protocol2.ping(2), devices, cut=(2,))) == [2]


def test_a_refused_part_has_its_error_and_no_data() -> None:
    said = _said(protocol2.sync_read(2000, 4, [1, 2]), _row(1, 2))
    assert [spoken.data for spoken in said] == [protocol2.status(1, 7), protocol2.status(2, 7)]


def test_the_fast_reply_of_the_manual() -> None:
    devices = _row(3, 4, 7)
    for device, value in zip(devices, (166, 1023, 2079), strict=True):
        device.memory[132:136] = value.to_bytes(4, "little")
    said = _said(protocol2.sync_read(132, 4, [3, 7, 4], fast=True), devices)
    expected = "FFFFFD00FE1900550003A6000000840800071F08000016CA0004FF030000D19E"
    assert b"".join(spoken.data for spoken in said) == bytes.fromhex(expected)
    assert [spoken.return_delay for spoken in said] == [0.0, None, None]


def test_a_fast_reply_is_cut_short_by_a_gap() -> None:
    request = protocol2.sync_read(132, 4, [1, 9, 2], fast=True)
    reply = b"".join(spoken.data for spoken in _said(request, _row(1, 2)))
    assert sound_parts(reply, [4, 4, 4]) == [Status(1, 0, b"\x01\0\0\0")]
    assert _said(protocol2.sync_read(132, 4, [9, 1], fast=True), _row(1, 2)) == []
    reply = b"".join(spoken.data for spoken in _said(request, _row(1, 2), Gaps.SKIP))
    assert len(reply) == 8 + 2 * 8


def test_a_device_without_fast_reads_is_a_gap_in_them_alone() -> None:
    devices = _row(1, 2)
    devices[1].fast_read = False
    assert _who(_said(protocol2.sync_read(132, 4, [1, 2], fast=True), devices)) == [1]
    assert _who(_said(protocol2.sync_read(132, 4, [1, 2]), devices)) == [1, 2]


def test_a_fast_bulk_read_has_parts_of_their_own_length() -> None:
    devices = _row(1, 2)
    devices[0].memory[126:128] = b"\xff\xff"
    said = _said(protocol2.bulk_read([(1, 126, 2), (2, 132, 4)], fast=True), devices)
    reply = b"".join(spoken.data for spoken in said)
    assert sound_parts(reply, [2, 4]) == [Status(1, 0, b"\xff\xff"), Status(2, 0, b"\x02\0\0\0")]


def test_two_devices_of_one_id_are_not_understood() -> None:
    (spoken,) = _said(protocol2.ping(1), _row(1, 1))
    assert parser2().feed(spoken.data) == []
    (again,) = _said(protocol2.ping(1), _row(1, 1))
    assert again == spoken
    (frame,) = parser2().feed(protocol2.ping(1))
    (other,) = Conversation(noise=random.Random(1)).answers(frame, _row(1, 1), 1.0)
    assert other.data != spoken.data
    reply = b"".join(part.data for part in _said(protocol2.sync_read(132, 4, [1, 2], fast=True), _row(1, 1, 2)))
    assert sound_parts(reply, [4, 4]) == []


def test_a_status_frame_is_no_instruction() -> None:
    devices = _row(1)
    assert _said(protocol2.status(1, 0), devices) == []
    assert devices[0].done == []


def test_protocol_1_has_bulk_read_and_sync_write() -> None:
    devices = _row(1, 2, protocol=1)
    devices[1].memory[36] = 9
    said = _said(protocol1.bulk_read([(2, 36, 2), (1, 36, 1)]), devices)
    assert [spoken.data for spoken in said] == [protocol1.status(2, 0, b"\x09\0"), protocol1.status(1, 0, b"\0")]
    assert _said(protocol1.sync_write(30, 1, [(1, b"\x07")]), devices) == []
    assert devices[0].memory[30] == 7


def test_an_ax_knows_no_bulk_read() -> None:
    devices = _row(1, 2, protocol=1)
    devices[1].model = "AX-12A"
    assert _who(_said(protocol1.bulk_read([(1, 36, 2), (2, 36, 2)]), devices)) == [1]
