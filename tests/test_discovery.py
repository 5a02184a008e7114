"""Who is on the line, and who is there twice."""

import pytest

from hardware.dynamixel import discovery, protocol1, protocol2
from hardware.dynamixel.discovery import Found
from hardware.dynamixel.packets import BROADCAST, Status
from scripted_port import Replies, ScriptedPort

SLACK = 0.004
PING1 = b"\x06\x04\x26"


def _slotted(*ids: int) -> Replies:
    return [(0.003 * device + 0.001, protocol2.status(device, 0, PING1)) for device in ids]


def test_all_answer_a_broadcast_in_their_slots() -> None:
    port = ScriptedPort(lambda request: _slotted(0, 1, 7, 252))
    heard = discovery.broadcast_ping(port, 252, SLACK)
    assert [answer.id for answer in heard.answers] == [0, 1, 7, 252]
    assert heard.damaged == 0
    assert port.sent == [protocol2.ping(BROADCAST)]
    assert discovery.found_by_broadcast(heard)[1] == Found(1, 2, 1030, 38)


def test_the_window_is_that_of_the_highest_id() -> None:
    port = ScriptedPort(lambda request: _slotted(20))
    assert discovery.broadcast_ping(port, 20, SLACK).answers
    assert 0.080 < port.now() < 0.095
    port = ScriptedPort(lambda request: [], baud=4_000_000)
    discovery.broadcast_ping(port, 252, SLACK)
    assert 0.770 < port.now() < 0.800


def test_damage_is_counted_and_the_sound_are_kept() -> None:
    broken = bytearray(protocol2.status(2, 0, PING1))
    broken[9] ^= 0x10
    port = ScriptedPort(lambda request: [*_slotted(1, 3), (0.007, bytes(broken))])
    heard = discovery.broadcast_ping(port, 5, SLACK)
    assert [answer.id for answer in heard.answers] == [1, 3]
    assert heard.damaged == len(broken)


def test_two_answers_to_a_broadcast_are_a_clash() -> None:
    port = ScriptedPort(lambda request: _slotted(1, 1, 2))
    found = discovery.found_by_broadcast(discovery.broadcast_ping(port, 5, SLACK))
    assert [(servo.id, servo.clash) for servo in found] == [(1, True), (2, False)]


@pytest.mark.parametrize("protocol", [1, 2])
def test_a_second_answer_to_one_ping_is_heard(protocol: int) -> None:
    answer = protocol1.status(4) if protocol == 1 else protocol2.status(4, 0, PING1)
    port = ScriptedPort(lambda request: [(0.0005, answer), (0.001, answer)])
    assert len(discovery.ping_alone(port, protocol, 4, SLACK).answers) == 2


@pytest.mark.parametrize("protocol", [1, 2])
def test_an_echo_is_no_answer(protocol: int) -> None:
    port = ScriptedPort(lambda request: [(0.0001, request)])
    heard = discovery.ping_alone(port, protocol, 4, SLACK)
    assert heard == discovery.Heard((), 0, True)


def test_a_line_that_never_falls_silent_is_left() -> None:
    port = ScriptedPort(lambda request: [(1e-5 * at, bytes(1000)) for at in range(200)])
    heard = discovery.broadcast_ping(port, 252, SLACK)
    assert heard.damaged <= discovery.MAX_HEARD + 1000
    assert port.now() < 0.1


def test_a_refused_ping_tells_no_model() -> None:
    assert discovery.found_by_ping(Status(3, 0x81, b"")) == Found(3, 2, None, None, alert=True)
