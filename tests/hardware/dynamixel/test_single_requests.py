"""One servo at a time: values, refusals, alerts, silence, damage, echo; nothing on the wire raises anything else."""

from contextlib import suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import more_frames
from hardware.dynamixel import single_requests
from hardware.dynamixel.codec import ALERT, BROADCAST, Error1, Error2, protocol1, protocol2
from hardware.dynamixel.control_table import find_table
from hardware.dynamixel.single_requests import FoundServo, NoAnswer, OneOff, ServoError
from hardware.errors import BusError
from messages import refuses, shows
from packet_vectors import Replies, ScriptedPort, always, in_turn

TABLE = find_table("XM430-W350", 2)
POSITION, GOAL = TABLE["present_position"], TABLE["goal_position"]
MX = find_table("MX-28", 1)
ANSWER = protocol2.status(1, 0, b"\xa6\0\0\0")


def _flipped(frame: bytes) -> bytes:
    return frame[:-3] + bytes((frame[-3] ^ 0x40,)) + frame[-2:]


@pytest.mark.parametrize("value", [0, -1, 2_048])
def test_what_is_written_is_what_the_codec_builds(value: int) -> None:
    port = ScriptedPort(always(protocol2.status(1)))
    OneOff(port, 2).write(1, GOAL, value)
    assert port.sent == [protocol2.write(1, 116, value.to_bytes(4, "little", signed=True))]


@pytest.mark.parametrize(("protocol", "device"), [(2, -1), (2, 253), (1, 254), (2, BROADCAST), (2, 300)])
def test_what_no_servo_can_have_or_do_is_not_sent(protocol: int, device: int) -> None:
    port = ScriptedPort(always())
    servo = OneOff(port, protocol)
    for ask in (servo.ping, lambda it: servo.scan([it]), lambda it: servo.read_block(it, 0, 2)):
        with refuses(ServoError, device):
            ask(device)
    with refuses(ServoError, 0, 255, 256):
        servo.write(1, TABLE["id"], 256)
    with refuses(ServoError):
        OneOff(port, 1).reboot(1)
    assert not port.sent


def test_a_refusal_is_reported_in_words_and_once() -> None:
    port = ScriptedPort(always(protocol2.status(5, Error2.ACCESS)))
    with refuses(ServoError, 5, "EEPROM", "id", f"error {Error2.ACCESS.value}"):
        OneOff(port, 2).write(5, TABLE["id"], 6)
    assert len(port.sent) == 1


@pytest.mark.parametrize("number", [error for error in Error2 if error])
def test_every_number_of_protocol_2_is_explained(number: Error2) -> None:
    assert single_requests.refusal(2, ALERT | number) == number
    assert single_requests.state(2, ALERT | number) == ALERT
    shows(single_requests.words(2, number))


@pytest.mark.parametrize("bit", list(Error1))
def test_a_bit_of_protocol_1_is_about_the_instruction_or_the_servo(bit: Error1) -> None:
    about_servo = bit in (Error1.INPUT_VOLTAGE, Error1.OVERHEATING, Error1.OVERLOAD)
    assert bool(single_requests.state(1, bit)) == about_servo
    assert bool(single_requests.refusal(1, bit)) != about_servo
    if not about_servo:
        shows(single_requests.words(1, bit))
    if bit in (Error1.RANGE, Error1.INSTRUCTION, Error1.ANGLE_LIMIT):
        servo = OneOff(ScriptedPort(always(protocol1.status(1, bit | Error1.OVERLOAD))), 1)
        with pytest.raises(ServoError, match=f"error {bit.value}:"):
            servo.write(1, MX["goal_position"], 4095)
        assert servo.alerted == {1}


def test_an_alert_is_reported_and_never_an_error() -> None:
    port = ScriptedPort(in_turn(protocol2.status(1, ALERT, b"\x20"), protocol2.status(1, 0, b"\0")))
    servo = OneOff(port, 2)
    assert servo.read(1, TABLE["hardware_error_status"]) == 0x20
    assert servo.alerted == {1}
    servo.read(1, TABLE["hardware_error_status"])
    assert not servo.alerted


@pytest.mark.parametrize(
    "bad",
    [
        b"",
        ANSWER[:-1],
        _flipped(ANSWER),
        protocol2.status(2, 0, b"\0\0\0\0"),
        protocol2.status(1, 0, b"\0\0"),
        protocol2.status(1, Error2.CRC),
        (no_error := bytes.fromhex("ff ff fd 00 01 03 00 55")) + more_frames.crc(no_error).to_bytes(2, "little"),
        b"\xff" * 30,
    ],
)
def test_one_bad_try_is_repeated(bad: bytes) -> None:
    port = ScriptedPort(in_turn(bad, ANSWER))
    assert OneOff(port, 2).read(1, POSITION) == 166
    assert len(port.sent) == 2


def test_later_tries_are_more_patient() -> None:
    delays = iter([1.0, 1.0, 0.014])
    assert OneOff(ScriptedPort(lambda request: [(next(delays), ANSWER)]), 2).read(1, POSITION) == 166


def test_tries_are_bounded_and_silence_is_reported() -> None:
    port = ScriptedPort(always())
    with refuses(NoAnswer, 1, "goal_position", "5", 3):
        OneOff(port, 2).write(1, GOAL, 5)
    assert len(port.sent) == 3
    assert port.now() < 0.1  # after each, a late answer may pass


def test_a_late_answer_answers_nothing_else() -> None:
    """The first try's answer comes during the second; what the second brings must not answer the next question."""
    delays = iter([0.007, 0.003, 0.0045])

    def answer(request: bytes) -> Replies:
        return [(next(delays), protocol2.status(1, 0, bytes((request[8], 0, 0, 0))))]

    servo = OneOff(ScriptedPort(answer), 2)
    assert servo.read(1, POSITION) == 132
    assert servo.read(1, GOAL) == 116


def test_written_values_can_be_verified_and_one_without_answer_counts_when_it_reads_back() -> None:
    OneOff(ScriptedPort(in_turn(protocol2.status(1), ANSWER)), 2).write(1, GOAL, 166, verify=True)
    with refuses(ServoError, 167, 166):
        OneOff(ScriptedPort(in_turn(protocol2.status(1), ANSWER)), 2).write(1, GOAL, 167, verify=True)
    servo = OneOff(ScriptedPort(lambda request: [(0.0005, ANSWER)] if request[7] == 2 else []), 2)
    servo.write(1, GOAL, 166, verify=True)
    with pytest.raises(NoAnswer):
        servo.write(1, GOAL, 166)


def test_a_port_that_is_gone_says_so_and_works_when_it_is_back() -> None:
    port = ScriptedPort(always(ANSWER))
    servo = OneOff(port, 2)
    port.broken = True
    with refuses(BusError):
        servo.read(1, POSITION)
    port.broken = False
    assert servo.read(1, POSITION) == 166


@settings(max_examples=150, deadline=None)
@given(
    st.sampled_from([1, 2]),
    st.lists(
        st.one_of(
            st.binary(max_size=30),
            *(
                st.builds(line.status, st.integers(0, 3), st.integers(0, 255), st.binary(max_size=5))
                for line in (protocol1, protocol2)
            ),
            st.sampled_from(
                [b"\xff\xff\xfd\x00\x01", b"\xff\xff\xfd\x00\x01\x00\x00\x55\0\0\0", b"\xff\xff\x01\x00\xfe"]
            ),
        ),
        max_size=5,
    ),
)
def test_whatever_the_line_says_nothing_else_is_raised(protocol: int, said: list[bytes]) -> None:
    register = POSITION if protocol == 2 else MX["present_position"]
    servo = OneOff(ScriptedPort(always(*said)), protocol)
    for ask in (lambda: servo.read(1, register), lambda: servo.ping(1), lambda: servo.scan([1, 2])):
        with suppress(BusError):
            ask()
    assert servo.port.now() < 0.6


@pytest.mark.parametrize(
    ("said", "found"),
    [
        ([protocol2.status(1, ALERT, b"\x06\x04\x26")], FoundServo(1, 2, 1030, 38, alert=True)),
        ([], None),
        ([protocol2.status(1, Error2.RESULT_FAIL)], FoundServo(1, 2)),
        ([b"\xff" * 14], FoundServo(1, 2, clash=True)),
    ],
)
def test_ping(said: list[bytes], found: FoundServo | None) -> None:
    assert OneOff(ScriptedPort(always(*said)), 2).ping(1) == found


@pytest.mark.parametrize("protocol", [1, 2])
def test_an_echo_is_dropped_and_counted_and_makes_no_servos(protocol: int) -> None:
    servo = OneOff(ScriptedPort(lambda request: [(0.0001, request)]), protocol)
    assert servo.ping(1) is None and servo.scan(range(4)) == []
    table = MX if protocol == 1 else TABLE
    answer = protocol1.status(1, 0, b"\x20") if protocol == 1 else protocol2.status(1, 0, b"\x20")
    servo = OneOff(ScriptedPort(lambda request: [(0.0001, request), (0.0008, answer)]), protocol)
    assert servo.read(1, table["present_temperature"]) == 32 and servo.echoes == 1


def test_an_answer_that_looks_like_an_echo() -> None:
    """A 1.0 servo with a voltage error answers a ping with the very bytes of the ping; it is found by a read."""
    model = protocol1.status(1, Error1.INPUT_VOLTAGE, b"\x1d\x00\x24")
    servo = OneOff(ScriptedPort(lambda request: [(0.0005, model if request[4] == 2 else request)]), 1)
    assert servo.ping(1) == FoundServo(1, 1, 29, 36, alert=True)
    assert servo.scan([1]) == [FoundServo(1, 1, 29, 36, alert=True)]


def test_scan_finds_a_clash_of_damaged_and_of_whole_answers() -> None:
    """The answers of two servos with id 2 collide; those of ids 1 and 3 stay valid."""

    def damaged(request: bytes) -> Replies:
        pinged = (1, 2, 3) if request[4] == BROADCAST else (request[4],)
        whole = [(0.003 * device, protocol2.status(device, 0, b"\x06\x04\x26")) for device in pinged if device < 4]
        return [(due, _flipped(frame) if frame[4] == 2 else frame) for due, frame in whole]

    def twice(request: bytes) -> Replies:
        frame = protocol1.status(2)
        return [(0.0005, frame), (0.0008, frame)] if request[2] == 2 and request[4] == 1 else []

    found = OneOff(ScriptedPort(damaged), 2).scan([1, 2, 3, 4])
    assert [(servo.id, servo.clash) for servo in found] == [(1, False), (2, True), (3, False)]
    assert OneOff(ScriptedPort(twice), 1).scan([1, 2]) == [FoundServo(2, 1, clash=True)]


@pytest.mark.parametrize("stale", [b"", b"\x00", ANSWER, b"\xff\xff\xfd\x00\x01"])
def test_stale_bytes_are_dropped_and_an_answer_in_drops_is_put_together(stale: bytes) -> None:
    answer = protocol2.status(1, 0, b"\x07\0\0\0")
    port = ScriptedPort(lambda request: [(0.0005 + 2e-5 * at, bytes((byte,))) for at, byte in enumerate(answer)])
    port.feed(stale)
    assert OneOff(port, 2).read(1, POSITION) == 7
    assert port.sent == [more_frames.read(1, 132, 4)]


def test_what_arrived_while_the_host_was_away_is_still_read() -> None:
    port = ScriptedPort(always(ANSWER))
    wait = port.wait

    def asleep(deadline: float) -> bool:
        port.clock.advance(1.0)
        return wait(deadline)

    port.wait = asleep  # type: ignore[method-assign]
    assert OneOff(port, 2, retries=0).read(1, POSITION) == 166


def test_an_answer_that_the_sdk_unstuffs_wrongly_counts_as_damaged() -> None:
    """Of dynamixel-sdk 4.1.0: FF FF FD FF FD FD loses a byte."""
    payload = b"\xff\xff\xfd\xff\xfd\xfd"
    with pytest.raises(NoAnswer):
        OneOff(ScriptedPort(always(protocol2.status(1, 0, payload))), 2).read_block(1, 116, len(payload))
