"""What dynamixel-sdk 4.1.0 gets wrong, shown on the SDK itself, and that ours does it right.

A newer SDK that fixes one of them fails the first half of its test: then our workaround may go.
"""

import itertools

import numpy as np
import pytest
from dynamixel_sdk import (
    COMM_PORT_BUSY,
    COMM_SUCCESS,
    GroupBulkRead,
    GroupSyncRead,
    GroupSyncWrite,
    Protocol1PacketHandler,
    Protocol2PacketHandler,
)

from hardware.dynamixel.codec import ALERT, Error2, Status, protocol1, protocol2
from hardware.dynamixel.control_table import find_table
from hardware.dynamixel.cyclic import Ask, Kind, Wired, collect, goal_packets
from hardware.dynamixel.single_requests import NoAnswer, OneOff, ServoError
from messages import refuses
from scripted_port import ScriptedPort, always
from sdk_line import FakeLine, sdk_over

TABLE = find_table("XM430-W350", 2)
GOAL, POSITION = TABLE["goal_position"], TABLE["present_position"]
FOUR = b"\xa6\0\0\0"


def test_1_stuffing_never_reaches_the_wire(monkeypatch: pytest.MonkeyPatch) -> None:
    """A single write of such a value is damaged, so the servo refuses it; what every cycle sends is right."""
    line = FakeLine(protocol2.status(1))
    Protocol2PacketHandler().write4ByteTxRx(sdk_over(line, monkeypatch), 1, 116, 0xFFFDFFFF)
    right = protocol2.write(1, 116, b"\xff\xff\xfd\xff")
    assert line.sent[0] != right
    assert b"\xff\xff\xfd\xff" in line.sent[0]

    (goals,) = goal_packets([Wired(0, 1, TABLE)])
    packet = goals.packet(np.array([-131_073]), np.array([True]))
    assert packet == protocol2.sync_write(116, 4, [(1, b"\xff\xff\xfd\xff")])


def test_2_unstuffing_loses_a_byte() -> None:
    """Such an answer has another size than what was asked, and counts as damaged."""
    lost: list[bytes] = []
    for payload in itertools.product(b"\xff\xfd", repeat=7):
        frame = protocol2.status(1, 0, bytes(payload))
        got = Protocol2PacketHandler().removeStuffing(list(frame))
        length = got[5] | got[6] << 8
        if bytes(got[9 : 5 + length]) != bytes(payload):
            lost.append(bytes(payload))
            port = ScriptedPort(always(frame))
            with pytest.raises(NoAnswer):
                OneOff(port, 2).read_block(1, 116, len(payload))
    assert lost


def _group(ids: range, answers: list[bytes], monkeypatch: pytest.MonkeyPatch) -> tuple[GroupSyncRead, int]:
    group = GroupSyncRead(sdk_over(FakeLine(b"".join(answers)), monkeypatch), Protocol2PacketHandler(), 132, 4)
    for device in ids:
        group.addParam(device)
    return group, group.txRxPacket()


def _ours(ids: range, answers: list[bytes]) -> list[Status]:
    port = ScriptedPort(always(b"".join(answers)))
    ask = Ask(Kind.SYNC, tuple(ids), 132, 4)
    port.write(ask.request())
    return collect(port, ask, port.now(), ask.timeouts(port, 0.0)).answers.statuses


def test_5_one_missing_servo_voids_all_others(monkeypatch: pytest.MonkeyPatch) -> None:
    ids = range(1, 21)
    answers = [protocol2.status(device, 0, FOUR) for device in ids[:-1]]
    group, result = _group(ids, answers, monkeypatch)
    assert result != COMM_SUCCESS
    assert not any(group.isAvailable(device, 132, 4) for device in ids)

    assert _ours(ids, answers) == [Status(device, 0, FOUR) for device in ids[:-1]]


def test_6_group_reads_hide_alerts(monkeypatch: pytest.MonkeyPatch) -> None:
    answers = [protocol2.status(1, ALERT, FOUR), protocol2.status(2, 0, FOUR)]
    group, result = _group(range(1, 3), answers, monkeypatch)
    assert result == COMM_SUCCESS
    assert group.getData(1, 132, 4) == group.getData(2, 132, 4) == 166

    assert [status.error for status in _ours(range(1, 3), answers)] == [ALERT, 0]


def test_7_a_refusal_without_data_is_an_index_error(monkeypatch: pytest.MonkeyPatch) -> None:
    refusal = protocol2.status(1, Error2.ACCESS)
    with pytest.raises(IndexError):
        Protocol2PacketHandler().read4ByteTxRx(sdk_over(FakeLine(refusal), monkeypatch), 1, 132)
    group, result = _group(range(1, 2), [refusal], monkeypatch)
    assert result == COMM_SUCCESS
    with pytest.raises(IndexError):
        group.getData(1, 132, 4)

    with refuses(ServoError):
        OneOff(ScriptedPort(always(refusal)), 2).read(1, POSITION)
    assert _ours(range(1, 2), [refusal]) == []


def test_7_a_refused_ping_has_a_model_made_of_its_crc(monkeypatch: pytest.MonkeyPatch) -> None:
    refusal = protocol2.status(1, Error2.RESULT_FAIL)
    model, result, _ = Protocol2PacketHandler().ping(sdk_over(FakeLine(refusal), monkeypatch), 1)
    assert (model, result) == (int.from_bytes(refusal[-2:], "little"), COMM_SUCCESS)

    found = OneOff(ScriptedPort(always(refusal)), 2).ping(1)
    assert found is not None
    assert found.model is None


def test_9_bulk_read_of_protocol_1_is_a_type_error(monkeypatch: pytest.MonkeyPatch) -> None:
    group = GroupBulkRead(sdk_over(FakeLine(), monkeypatch), Protocol1PacketHandler())
    group.addParam(1, 36, 2)
    with pytest.raises(TypeError):
        group.txRxPacket()

    port = ScriptedPort(always(protocol1.status(1, 0, b"\x00\x08")))
    ask = Ask(Kind.BULK1, (1,), 36, 2)
    port.write(ask.request())
    assert collect(port, ask, port.now(), ask.timeouts(port, 0.0)).answers.statuses == [Status(1, 0, b"\x00\x08")]


def test_14_a_group_write_takes_data_that_are_too_short(monkeypatch: pytest.MonkeyPatch) -> None:
    line = FakeLine()
    group = GroupSyncWrite(sdk_over(line, monkeypatch), Protocol2PacketHandler(), 116, 4)
    assert group.addParam(1, [0x96, 0x00])
    with pytest.raises(IndexError):
        group.txPacket()
    assert group.txPacket() == COMM_PORT_BUSY

    with refuses(ValueError, 2, 1, 4):
        protocol2.sync_write(116, 4, [(1, b"\x96\0")])
    (goals,) = goal_packets([Wired(0, 1, TABLE)])
    assert goals.packet(np.array([0x96]), np.array([True])) == protocol2.sync_write(116, 4, [(1, b"\x96\0\0\0")])


def test_14_values_come_back_unsigned(monkeypatch: pytest.MonkeyPatch) -> None:
    answer = protocol2.status(1, 0, b"\xff" * 4)
    assert Protocol2PacketHandler().read4ByteTxRx(sdk_over(FakeLine(answer), monkeypatch), 1, 132)[0] == 2**32 - 1
    assert OneOff(ScriptedPort(always(answer)), 2).read(1, POSITION) == -1
