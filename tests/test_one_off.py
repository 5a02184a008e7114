"""One servo at a time: values, refusals, alerts, silence, damage, echo; nothing on the wire raises anything else."""

import threading

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.dynamixel import protocol1, protocol2
from hardware.dynamixel.control_table import find_table
from hardware.dynamixel.one_off import NoAnswer, OneOff, ResetScope, ServoError
from hardware.dynamixel.packets import ALERT, BROADCAST, Error1, Error2
from hardware.dynamixel.register import Register
from hardware.errors import BusError
from scripted_port import Replies, ScriptedPort, always, in_turn
from support.messages import refuses

TABLE = find_table("XM430-W350", 2)
POSITION, GOAL = TABLE["present_position"], TABLE["goal_position"]
MX = find_table("MX-28", 1)
ANSWER = protocol2.status(1, 0, b"\xa6\0\0\0")


def _flipped(frame: bytes) -> bytes:
    return frame[:-3] + bytes((frame[-3] ^ 0x40,)) + frame[-2:]


def test_a_value_is_signed() -> None:
    port = ScriptedPort(always(protocol2.status(1, 0, b"\xff\xff\xff\xff")))
    assert OneOff(port, 2).read(1, POSITION) == -1
    assert port.sent == [protocol2.read(1, 132, 4)]


@pytest.mark.parametrize("value", [0, -1, -131_073, 2_048])
def test_what_is_written_is_what_the_codec_builds(value: int) -> None:
    port = ScriptedPort(always(protocol2.status(1)))
    OneOff(port, 2).write(1, GOAL, value)
    assert port.sent == [protocol2.write(1, 116, value.to_bytes(4, "little", signed=True))]


def test_protocol_1_both_ways() -> None:
    port = ScriptedPort(in_turn(protocol1.status(1, 0, b"\x00\x08"), protocol1.status(1)))
    servo = OneOff(port, 1)
    assert servo.read(1, MX["present_position"]) == 2048
    servo.write(1, MX["goal_position"], 500)
    assert port.sent == [protocol1.read(1, 36, 2), protocol1.write(1, 30, b"\xf4\x01")]


def test_the_other_instructions() -> None:
    port = ScriptedPort(always(protocol2.status(1)))
    servo = OneOff(port, 2)
    servo.reboot(1)
    servo.clear(1)
    servo.factory_reset(1, ResetScope.ID)
    assert port.sent == [protocol2.reboot(1), protocol2.clear_turns(1), protocol2.factory_reset(1, 1)]
    port = ScriptedPort(always(protocol1.status(1)))
    OneOff(port, 1).factory_reset(1, ResetScope.NOTHING)
    assert port.sent == [protocol1.factory_reset(1)]


def test_protocol_1_has_no_reboot() -> None:
    port = ScriptedPort(always())
    servo = OneOff(port, 1)
    for ask in (servo.reboot, servo.clear, servo.factory_reset):
        with refuses(ServoError):
            ask(1)
    assert not port.sent


@pytest.mark.parametrize(("protocol", "device"), [(2, -1), (2, 253), (1, 254), (2, BROADCAST), (2, 300)])
def test_ids_that_nobody_can_have(protocol: int, device: int) -> None:
    port = ScriptedPort(always())
    servo = OneOff(port, protocol)
    for ask in (servo.ping, lambda it: servo.scan([it]), lambda it: servo.read_block(it, 0, 2)):
        with refuses(ServoError, device):
            ask(device)
    assert not port.sent


def test_a_refusal_is_told_in_words_and_once() -> None:
    port = ScriptedPort(always(protocol2.status(5, Error2.ACCESS)))
    with refuses(ServoError, 5, "EEPROM") as raised:
        OneOff(port, 2).write(5, TABLE["id"], 6)
    assert (raised.value.id, raised.value.register, raised.value.number) == (5, "id", Error2.ACCESS)
    assert len(port.sent) == 1


def test_a_refused_read_brings_no_value() -> None:
    """An error status without data: the SDK ends in an IndexError."""
    port = ScriptedPort(always(protocol2.status(1, Error2.ACCESS)))
    with refuses(ServoError, "present_position"):
        OneOff(port, 2).read(1, POSITION)


@pytest.mark.parametrize("bit", [Error1.RANGE, Error1.INSTRUCTION, Error1.ANGLE_LIMIT])
def test_refusals_of_protocol_1(bit: Error1) -> None:
    port = ScriptedPort(always(protocol1.status(1, bit | Error1.OVERLOAD)))
    servo = OneOff(port, 1)
    with pytest.raises(ServoError) as raised:
        servo.write(1, MX["goal_position"], 4095)
    assert raised.value.number == bit
    assert servo.alerted == (1,)


def test_an_alert_is_reported_and_never_an_error() -> None:
    port = ScriptedPort(in_turn(protocol2.status(1, ALERT, b"\x20"), protocol2.status(1, 0, b"\0")))
    servo = OneOff(port, 2)
    assert servo.read(1, TABLE["hardware_error_status"]) == 0x20
    assert servo.alerted == (1,)
    servo.read(1, TABLE["hardware_error_status"])
    assert not servo.alerted


def test_a_servo_of_protocol_1_in_trouble_still_answers() -> None:
    port = ScriptedPort(always(protocol1.status(1, Error1.OVERHEATING | Error1.INPUT_VOLTAGE, b"\x50")))
    servo = OneOff(port, 1)
    assert servo.read(1, MX["present_temperature"]) == 80
    assert servo.alerted == (1,)


@pytest.mark.parametrize(
    "bad",
    [
        b"",
        ANSWER[:-1],
        _flipped(ANSWER),
        protocol2.status(2, 0, b"\0\0\0\0"),
        protocol2.status(1, 0, b"\0\0"),
        protocol2.status(1, Error2.CRC),
        b"\xff\xff\xfd\x00\x01\x03\x00\x55" + protocol2.crc(b"\xff\xff\xfd\x00\x01\x03\x00\x55").to_bytes(2, "little"),
        b"\xff" * 30,
    ],
)
def test_one_bad_try_is_repeated(bad: bytes) -> None:
    port = ScriptedPort(in_turn(bad, ANSWER))
    assert OneOff(port, 2).read(1, POSITION) == 166
    assert len(port.sent) == 2


@pytest.mark.parametrize("before", [b"\0\xff\xff", protocol2.status(9, 0, b"\1\2\3\4"), protocol2.read(1, 132, 4)])
def test_what_stands_before_the_answer_is_skipped(before: bytes) -> None:
    port = ScriptedPort(always(before + ANSWER))
    assert OneOff(port, 2).read(1, POSITION) == 166
    assert len(port.sent) == 1


def test_a_status_too_short_to_be_one_is_damage() -> None:
    short = protocol2.HEADER + b"\x01\x03\x00\x55"
    short += protocol2.crc(short).to_bytes(2, "little") + b"\0"
    port = ScriptedPort(in_turn(short, protocol2.status(1)))
    OneOff(port, 2).write(1, GOAL, 0)
    assert len(port.sent) == 2


def test_later_tries_are_more_patient() -> None:
    delays = iter([1.0, 1.0, 0.014])
    assert OneOff(ScriptedPort(lambda request: [(next(delays), ANSWER)]), 2).read(1, POSITION) == 166


def test_tries_are_bounded_and_silence_is_told() -> None:
    port = ScriptedPort(always())
    with refuses(NoAnswer, 1, "goal_position", "5", 3):
        OneOff(port, 2).write(1, GOAL, 5)
    assert len(port.sent) == 3
    assert port.now() < 0.1  # after each, a late answer may pass


def test_damage_is_told_from_silence() -> None:
    port = ScriptedPort(in_turn(_flipped(ANSWER), b"", _flipped(ANSWER)))
    with refuses(NoAnswer, 2) as raised:
        OneOff(port, 2).read(1, POSITION)
    assert (raised.value.tries, raised.value.damaged) == (3, 2)


def test_a_late_answer_answers_nothing_else() -> None:
    """The first try's answer comes during the second; what the second brings must not answer the next question."""
    delays = iter([0.007, 0.003, 0.0045])

    def answer(request: bytes) -> Replies:
        return [(next(delays), protocol2.status(1, 0, bytes((request[8], 0, 0, 0))))]

    servo = OneOff(ScriptedPort(answer), 2)
    assert servo.read(1, POSITION) == 132
    assert servo.read(1, GOAL) == 116


def test_written_values_can_be_verified() -> None:
    port = ScriptedPort(in_turn(protocol2.status(1), ANSWER))
    OneOff(port, 2).write(1, GOAL, 166, verify=True)
    port = ScriptedPort(in_turn(protocol2.status(1), ANSWER))
    with refuses(ServoError, 167, 166):
        OneOff(port, 2).write(1, GOAL, 167, verify=True)


def test_a_muted_write_counts_when_it_reads_back() -> None:
    port = ScriptedPort(lambda request: [(0.0005, ANSWER)] if request[7] == 2 else [])
    OneOff(port, 2).write(1, GOAL, 166, verify=True)
    with pytest.raises(NoAnswer):
        OneOff(port, 2).write(1, GOAL, 166)


def test_a_value_wider_than_its_register_is_not_sent() -> None:
    port = ScriptedPort(always())
    with refuses(ServoError, 0, 255, 256):
        OneOff(port, 2).write(1, TABLE["id"], 256)
    assert not port.sent


@pytest.mark.parametrize("length", [0, -1, 1000])
def test_lengths_that_no_answer_has(length: int) -> None:
    with refuses(ServoError, 1):
        OneOff(ScriptedPort(always()), 2).read_block(1, 0, length)


def test_threads_wait_for_each_other() -> None:
    servo = OneOff(ScriptedPort(always(ANSWER)), 2)
    values: list[int] = []
    threads = [
        threading.Thread(target=lambda: values.extend(servo.read(1, POSITION) for _ in range(30))) for _ in range(3)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(10.0)
    assert values == [166] * 90


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
            st.builds(protocol2.status, st.integers(0, 3), st.integers(0, 255), st.binary(max_size=5)),
            st.builds(protocol1.status, st.integers(0, 3), st.integers(0, 255), st.binary(max_size=5)),
            st.sampled_from(
                [b"\xff\xff\xfd\x00\x01", b"\xff\xff\xfd\x00\x01\x00\x00\x55\0\0\0", b"\xff\xff\x01\x00\xfe"]
            ),
        ),
        max_size=5,
    ),
)
def test_whatever_the_line_says_nothing_else_is_raised(protocol: int, said: list[bytes]) -> None:
    table: Register = POSITION if protocol == 2 else MX["present_position"]
    servo = OneOff(ScriptedPort(always(*said)), protocol)
    for ask in (lambda: servo.read(1, table), lambda: servo.ping(1), lambda: servo.scan([1, 2])):
        try:
            ask()
        except BusError:
            continue
    assert servo.port.now() < 0.6
