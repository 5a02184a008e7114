"""Who is there: single pings and scans, clashes, echo, both protocols."""

from hardware.dynamixel import protocol1, protocol2
from hardware.dynamixel.discovery import Found
from hardware.dynamixel.one_off import OneOff
from hardware.dynamixel.packets import ALERT, BROADCAST, Error1, Error2
from scripted_port import Replies, ScriptedPort, always, in_turn


def _flipped(frame: bytes) -> bytes:
    return frame[:-3] + bytes((frame[-3] ^ 0x40,)) + frame[-2:]


def test_ping() -> None:
    assert OneOff(ScriptedPort(always(protocol2.status(1, ALERT, b"\x06\x04\x26"))), 2).ping(1) == Found(
        1, 2, 1030, 38, alert=True
    )
    assert OneOff(ScriptedPort(always()), 2).ping(1) is None
    assert OneOff(ScriptedPort(always(protocol2.status(1, Error2.RESULT_FAIL))), 2).ping(1) == Found(1, 2)
    assert OneOff(ScriptedPort(always(b"\xff" * 14)), 2).ping(1) == Found(1, 2, clash=True)


def test_ping_of_protocol_1_reads_the_model() -> None:
    port = ScriptedPort(in_turn(protocol1.status(1), protocol1.status(1, 0, b"\x1d\x00\x24")))
    assert OneOff(port, 1).ping(1) == Found(1, 1, 29, 36)
    assert OneOff(ScriptedPort(in_turn(protocol1.status(1))), 1).ping(1) == Found(1, 1)


def _echoing(request: bytes) -> Replies:
    return [(0.0001, request)]


def test_an_echo_makes_no_servos() -> None:
    for protocol in (1, 2):
        servo = OneOff(ScriptedPort(_echoing), protocol)
        assert servo.ping(1) is None
        assert servo.scan(range(4)) == []


def test_an_answer_that_looks_like_an_echo() -> None:
    """A 1.0 servo with a voltage error answers a ping with the very bytes of the ping; it is found by a read."""
    model = protocol1.status(1, Error1.INPUT_VOLTAGE, b"\x1d\x00\x24")
    port = ScriptedPort(lambda request: [(0.0005, model if request[4] == 2 else request)])
    servo = OneOff(port, 1)
    assert servo.ping(1) == Found(1, 1, 29, 36, alert=True)
    assert servo.scan([1]) == [Found(1, 1, 29, 36, alert=True)]


def _line(*ids: int) -> ScriptedPort:
    def answer(request: bytes) -> Replies:
        asked = ids if request[4] == BROADCAST else [device for device in ids if device == request[4]]
        return [(0.003 * device, protocol2.status(device, 0, b"\x06\x04\x26")) for device in asked]

    return ScriptedPort(answer)


def test_scan_finds_the_wanted_and_the_unknown() -> None:
    port = _line(1, 2, 5)
    assert [servo.id for servo in OneOff(port, 2).scan([1, 2, 3, 6])] == [1, 2, 5]
    assert port.sent == [protocol2.ping(BROADCAST), protocol2.ping(3), protocol2.ping(6)]


def test_scan_asks_alone_when_the_broadcast_is_lost() -> None:
    def answer(request: bytes) -> Replies:
        return [] if request[4] == BROADCAST else [(0.0005, protocol2.status(request[4], 0, b"\x06\x04\x26"))]

    assert [servo.id for servo in OneOff(ScriptedPort(answer), 2).scan([3, 1])] == [1, 3]


def test_scan_finds_a_clash() -> None:
    """Two servos with id 2 talk into each other, whoever asks; ids 1 and 3 stay sound."""

    def answer(request: bytes) -> Replies:
        pinged = (1, 2, 3) if request[4] == BROADCAST else (request[4],)
        whole = [(0.003 * device, protocol2.status(device, 0, b"\x06\x04\x26")) for device in pinged if device < 4]
        return [(due, _flipped(frame) if frame[4] == 2 else frame) for due, frame in whole]

    found = OneOff(ScriptedPort(answer), 2).scan([1, 2, 3, 4])
    assert [(servo.id, servo.clash) for servo in found] == [(1, False), (2, True), (3, False)]


def test_scan_looks_again_when_one_of_two_answers_was_whole() -> None:
    whole = protocol2.status(2, 0, b"\x06\x04\x26")
    port = ScriptedPort(
        lambda request: [(0.007, whole + _flipped(whole))] if request[4] == BROADCAST else [(0.001, _flipped(whole))]
    )
    assert OneOff(port, 2).scan([2]) == [Found(2, 2, clash=True)]


def test_scan_finds_a_clash_of_whole_answers() -> None:
    def answer(request: bytes) -> Replies:
        frame = protocol1.status(2)
        return [(0.0005, frame), (0.0008, frame)] if request[2] == 2 and request[4] == 1 else []

    assert OneOff(ScriptedPort(answer), 1).scan([1, 2]) == [Found(2, 1, clash=True)]


def test_scan_of_nothing_sends_nothing() -> None:
    port = _line(1)
    assert OneOff(port, 2).scan([]) == []
    assert not port.sent
