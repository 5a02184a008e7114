"""Goals as one packet: golden bytes, stuffing, what a servo makes of it."""

import numpy as np
import pytest

from bus_rig import BusRig, spec, specs
from hardware.dynamixel import protocol2
from hardware.dynamixel.control_table import find_table
from hardware.dynamixel.cyclic import Wired
from hardware.dynamixel.goal_packet import GoalPacket
from hardware.dynamixel.packets import Instruction
from hardware.dynamixel.parsers import parser1, parser2

GOLDEN = "ff ff fd 00 fe 16 00 83 74 00 04 00 01 00 08 00 00 02 01 08 00 00 03 ff 07 00 00"
GOLDEN1 = "ff ff fe 0d 83 1e 02 01 00 02 02 01 02 03 ff 01"


def wired(model: str, protocol: int, count: int = 3) -> list[Wired]:
    return [Wired(index, index + 1, find_table(model, protocol)) for index in range(count)]


def test_the_bytes_for_ids_1_to_3() -> None:
    """By hand from the layout of a sync write: address 116, 4 bytes each; the CRC by the long division of the CRC-16
    with polynomial 0x8005."""
    body = bytes.fromhex(GOLDEN)
    register = 0
    for byte in body:
        register ^= byte << 8
        for _ in range(8):
            register = (register << 1 ^ (0x8005 if register & 0x8000 else 0)) & 0xFFFF
    (packet,) = GoalPacket(wired("XM430-W350", 2)).packets(np.array([2048, 2049, 2047]), np.full(3, True))
    assert packet == body + register.to_bytes(2, "little")


def test_the_bytes_of_protocol_1() -> None:
    body = bytes.fromhex(GOLDEN1)
    (packet,) = GoalPacket(wired("AX-12A", 1)).packets(np.array([512, 513, 511]), np.full(3, True))
    assert packet == body + bytes([~sum(body[2:]) & 0xFF])
    (frame,) = parser1().feed(packet)
    assert frame.code == Instruction.SYNC_WRITE


def test_a_header_among_the_goals_is_stuffed() -> None:
    goals = np.array([0xFDFFFF, -0x020001, 0xFDFFFF - 2**24])
    (packet,) = GoalPacket(wired("XM430-W350", 2)).packets(goals, np.full(3, True))
    assert packet.count(protocol2.HEADER) == 1
    assert packet.count(b"\xff\xff\xfd\xfd") >= 1
    (frame,) = parser2().feed(packet)
    rows = np.frombuffer(frame.params[4:], dtype=[("id", "u1"), ("goal", "<i4")])
    assert rows["id"].tolist() == [1, 2, 3]
    assert rows["goal"].tolist() == goals.tolist()


def test_servos_with_goals_in_other_places_get_a_packet_of_their_own() -> None:
    servos = [*wired("MX-28", 1, 2), Wired(2, 3, find_table("XM430-W350", 2))]
    packets = list(GoalPacket(servos).packets(np.array([1, 2, 3]), np.full(3, True)))
    assert [packet[:4] for packet in packets] == [b"\xff\xff\xfe\x0a", b"\xff\xff\xfd\x00"]


@pytest.mark.parametrize("goals", [(0, 4095), (255, 253), (2048, 0)])
def test_servos_hold_what_was_sent(goals: tuple[int, int]) -> None:
    rig = BusRig(specs(2)).ready()
    rig.tick(goals)
    assert rig.shown("goal_position") == list(goals)


def test_a_packet_reaches_only_its_own_port() -> None:
    servos = [spec(1), spec(2)]
    packet = GoalPacket([Wired(1, 2, find_table("XM430-W350", 2))]).packets(np.array([7, 9]), np.full(2, True))
    (frame,) = parser2().feed(next(packet))
    assert frame.params[4:] == bytes([servos[1].id, 9, 0, 0, 0])


def test_a_limp_servo_of_protocol_1_is_sent_no_goal() -> None:
    maker = GoalPacket(wired("AX-12A", 1))
    (packet,) = maker.packets(np.array([512, 513, 511]), np.array([True, False, True]))
    (frame,) = parser1().feed(packet)
    assert len(frame.params) == 2 + 2 * 3
    assert list(maker.packets(np.array([512, 513, 511]), np.full(3, False))) == []
    (packet,) = GoalPacket(wired("XM430-W350", 2)).packets(np.array([1, 2, 3]), np.full(3, False))
    assert len(packet) == 10 + 4 + 3 * 5
