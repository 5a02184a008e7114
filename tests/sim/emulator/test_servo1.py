"""Emulated servos of protocol 1.0."""

from collections.abc import Callable

import pytest

from emulated import read_register1, servo1, write_register1
from hardware.dynamixel.codec import Error1, Instruction, protocol1
from hardware.dynamixel.control_table import find_table
from hardware.servo import find_model
from sim.emulator.conversation import Conversation
from sim.emulator.device import Answer
from sim.emulator.servo1 import EmulatedServo1
from sim.emulator.servo_body import ServoBuild


def replies(servo: EmulatedServo1, code: int, params: bytes = b"", now: float = 0.0) -> Answer | None:
    return servo.execute(code, params, now, broadcast=False)


@pytest.mark.parametrize(("model", "goal"), [("MX-28", 2500), ("MX-64", 1500), ("AX-12A", 700)])
def test_it_goes_to_its_goal(model: str, goal: int) -> None:
    servo = servo1(model, position=512.0)
    assert replies(servo, Instruction.PING) == (0, b"")
    assert read_register1(servo, "torque_enable") == 0
    assert write_register1(servo, "goal_position", goal) == 0
    assert read_register1(servo, "torque_enable") == 1
    assert read_register1(servo, "present_position", 3.0) == goal and read_register1(servo, "moving", 3.0) == 0


def test_it_waits_for_torque_where_a_goal_does_not_switch_it_on() -> None:
    servo = EmulatedServo1(find_table("MX-28", 1), find_model("MX-28"), ServoBuild(512.0), torque_by_goal=False)
    assert write_register1(servo, "goal_position", 2500) == 0
    assert write_register1(servo, "moving_speed", 0) == 0
    assert read_register1(servo, "torque_enable", 1.0) == 0 and read_register1(servo, "present_position", 1.0) == 512
    assert write_register1(servo, "torque_enable", 1, 1.0) == 0
    assert read_register1(servo, "present_position", 4.0) == 2500


def _single(servo: EmulatedServo1, address: int, data: bytes) -> None:
    replies(servo, Instruction.WRITE, bytes((address,)) + data)


def _sync(servo: EmulatedServo1, address: int, data: bytes) -> None:
    (frame,) = protocol1.parser().feed(protocol1.sync_write(address, len(data), [(1, data)]))
    assert Conversation().answers(frame, [servo], 0.0) == []


def _registered(servo: EmulatedServo1, address: int, data: bytes) -> None:
    replies(servo, Instruction.REG_WRITE, bytes((address,)) + data)
    assert read_register1(servo, "torque_enable") == 0  # not before the Action
    replies(servo, Instruction.ACTION)


@pytest.mark.parametrize("write", [_single, _sync, _registered])
@pytest.mark.parametrize(
    ("address", "data", "torque"),
    [
        (30, (700).to_bytes(2, "little"), 1),
        (32, bytes(2), 1),
        (30, (700).to_bytes(2, "little") + bytes(2), 1),
        (28, bytes((32, 32)) + (700).to_bytes(2, "little"), 1),
        (28, bytes((32, 32)), 0),
        (34, (500).to_bytes(2, "little"), 0),
        (30, (1024).to_bytes(2, "little"), 0),  # refused
    ],
)
def test_what_reaches_goal_or_speed_switches_torque_on(
    write: Callable[[EmulatedServo1, int, bytes], None], address: int, data: bytes, torque: int
) -> None:
    servo = servo1("AX-12A", position=512.0)
    write(servo, address, data)
    assert read_register1(servo, "torque_enable") == torque
    assert servo.shaft.torque is bool(torque)


def test_a_goal_switches_no_torque_on_that_an_error_bars() -> None:
    servo = servo1("AX-12A", position=512.0)
    servo.heat(71.0, 1.0)
    assert write_register1(servo, "goal_position", 700, 1.0) == Error1.OVERHEATING
    assert read_register1(servo, "torque_enable", 1.0) == 0 and read_register1(servo, "present_position", 3.0) == 512
    servo.heat(None, 3.0)
    assert write_register1(servo, "goal_position", 700, 3.0) == 0
    assert read_register1(servo, "torque_enable", 3.0) == 1


def test_a_goal_does_not_undo_an_overload() -> None:
    servo = servo1()
    write_register1(servo, "torque_enable", 1)
    servo.jam(True, 0.0)
    write_register1(servo, "goal_position", 4000)
    overloaded = [servo.read(24, 1, 0.05 * step) for step in range(60)][-1]
    assert overloaded == (Error1.OVERLOAD, b"\0")
    servo.jam(False, 3.0)
    assert write_register1(servo, "goal_position", 3000, 3.0) == Error1.OVERLOAD
    assert read_register1(servo, "torque_enable", 3.0) == 0


def test_moving_speed_slows_down() -> None:
    servo = servo1(position=0.0)
    write_register1(servo, "moving_speed", 100)  # 11.4 rpm
    write_register1(servo, "torque_enable", 1)
    write_register1(servo, "goal_position", 4000)
    assert read_register1(servo, "present_position", 2.0) == pytest.approx(2 * 11.4 / 60 * 4096, rel=0.08)
    assert read_register1(servo, "present_speed", 2.0) == pytest.approx(100, abs=1)


@pytest.mark.parametrize(
    ("address", "data", "error"),
    [
        (30, (4096).to_bytes(2, "little"), Error1.ANGLE_LIMIT),
        (36, bytes(2), Error1.RANGE),
        (3, bytes((254,)), Error1.RANGE),
        (30, bytes(1), Error1.RANGE),
        (200, bytes(1), Error1.RANGE),
    ],
)
def test_a_bad_write_changes_nothing(address: int, data: bytes, error: Error1) -> None:
    servo = servo1()
    before = bytes(servo.memory.image)
    assert replies(servo, Instruction.WRITE, bytes((address,)) + data) == (error, b"")
    assert bytes(servo.memory.image) == before


def test_instructions_that_it_does_not_know() -> None:
    servo = servo1()
    for code in (Instruction.REBOOT, Instruction.CLEAR, 0x84, Instruction.SYNC_READ):
        assert replies(servo, code) == (Error1.INSTRUCTION, b"")
    assert replies(servo, Instruction.ACTION) == (Error1.INSTRUCTION, b"")


def test_registered_write_and_lock() -> None:
    servo = servo1()
    assert replies(servo, Instruction.REG_WRITE, b"\x19\1") == (0, b"")
    assert read_register1(servo, "registered") == 1 and read_register1(servo, "led") == 0
    assert replies(servo, Instruction.ACTION) == (0, b"")
    assert read_register1(servo, "registered") == 0 and read_register1(servo, "led") == 1
    assert write_register1(servo, "id", 5) == 0 and servo.id == 5
    write_register1(servo, "lock", 1)
    assert (
        write_register1(servo, "id", 6) == Error1.RANGE
        and write_register1(servo, "lock", 0) == Error1.RANGE
        and servo.id == 5
    )


def test_an_overload_takes_the_torque_until_it_is_written_again() -> None:
    servo = servo1()
    write_register1(servo, "torque_enable", 1)
    servo.jam(True, 0.0)
    write_register1(servo, "goal_position", 4000)
    answers = [servo.read(24, 1, 0.05 * step) for step in range(60)]
    assert answers[2] == (0, b"\1") and answers[-1] == (Error1.OVERLOAD, b"\0")
    assert read_register1(servo, "torque_limit", 3.0) == 0
    servo.jam(False, 3.0)
    write_register1(servo, "torque_limit", 1023, 3.0)
    assert write_register1(servo, "torque_enable", 1, 3.0) == 0
    assert read_register1(servo, "present_position", 6.0) == 4000


def test_heat_is_reported_while_it_lasts() -> None:
    servo = servo1("AX-12A", position=512.0)
    write_register1(servo, "torque_enable", 1)
    servo.heat(71.0, 1.0)
    assert servo.read(24, 1, 1.0) == (Error1.OVERHEATING, b"\0")
    assert (
        write_register1(servo, "torque_enable", 1, 1.0) == Error1.OVERHEATING
        and read_register1(servo, "torque_enable", 1.0) == 0
    )
    servo.heat(None, 2.0)
    assert servo.read(24, 1, 2.0).error == 0
    servo.supply(5.5, 2.0)
    assert servo.read(42, 1, 2.0) == (Error1.INPUT_VOLTAGE, bytes((55,)))


def test_wheel_and_multi_turn() -> None:
    wheel = servo1()
    write_register1(wheel, "ccw_angle_limit", 0)
    write_register1(wheel, "torque_enable", 1)
    write_register1(wheel, "moving_speed", -200)
    assert read_register1(wheel, "present_speed", 1.0) == -200
    turns = servo1()
    write_register1(turns, "cw_angle_limit", 4095)
    write_register1(turns, "torque_enable", 1)
    assert write_register1(turns, "goal_position", 9000) == 0
    assert read_register1(turns, "present_position", 20.0) == 9000


def test_factory_reset_and_status_return_level() -> None:
    servo = servo1()
    write_register1(servo, "id", 9)
    assert replies(servo, Instruction.FACTORY_RESET) == (0, b"")
    assert servo.id == 1 and servo.booting(0.1)
    servo.write(16, b"\0", 1.0)
    assert replies(servo, Instruction.READ, b"\x24\2", 1.0) is None and replies(servo, Instruction.PING, b"", 1.0) == (
        0,
        b"",
    )
    assert not servo.answers_reads
