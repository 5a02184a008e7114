"""Emulated servos of protocol 1.0."""

from collections.abc import Callable

import pytest

from emulated import answered, read_register, servo1, shown, write_register, wrote
from hardware.dynamixel.codec import Error1, Instruction, protocol1
from sim.emulator.conversation import Conversation
from sim.emulator.servo1 import EmulatedServo1


def _single(servo: EmulatedServo1, address: int, data: bytes) -> None:
    answered(servo, Instruction.WRITE, bytes((address,)) + data)


def _sync(servo: EmulatedServo1, address: int, data: bytes) -> None:
    (frame,) = protocol1.parser().feed(protocol1.sync_write(address, len(data), [(1, data)]))
    assert Conversation().answers(frame, [servo], 0.0) == []


def _registered(servo: EmulatedServo1, address: int, data: bytes) -> None:
    answered(servo, Instruction.REG_WRITE, bytes((address,)) + data)
    assert read_register(servo, "torque_enable") == 0  # not before the Action
    answered(servo, Instruction.ACTION)


@pytest.mark.parametrize("write", [_single, _sync, _registered])
@pytest.mark.parametrize(
    ("address", "data", "torque"),
    [
        (30, (700).to_bytes(2, "little"), 1),
        (32, bytes(2), 1),
        (28, bytes((32, 32)) + (700).to_bytes(2, "little"), 1),
        (28, bytes((32, 32)), 0),
        (34, (500).to_bytes(2, "little"), 0),
        (30, (1024).to_bytes(2, "little"), 0),  # refused
    ],
)
def test_a_write_to_goal_or_speed_switches_torque_on(
    write: Callable[[EmulatedServo1, int, bytes], None], address: int, data: bytes, torque: int
) -> None:
    servo = servo1("AX-12A", position=512.0)
    write(servo, address, data)
    assert read_register(servo, "torque_enable") == torque and servo.shaft.torque is bool(torque)


def test_heat_is_reported_while_it_lasts_and_bars_torque() -> None:
    servo = servo1("AX-12A", position=512.0)
    wrote(servo, torque_enable=1)
    servo.heat(71.0, 1.0)
    assert servo.read(24, 1, 1.0) == (Error1.OVERHEATING, b"\0")
    for name, value in (("torque_enable", 1), ("goal_position", 700)):
        assert write_register(servo, name, value, 1.0) == Error1.OVERHEATING
    assert shown(servo, 2.0, "torque_enable", "present_position") == (0, 512)
    servo.heat(None, 3.0)
    wrote(servo, 3.0, goal_position=700)
    assert read_register(servo, "torque_enable", 3.0) == 1
    servo.supply(5.5, 3.0)
    assert servo.read(42, 1, 3.0) == (Error1.INPUT_VOLTAGE, bytes((55,)))


def test_an_overload_takes_the_torque_until_its_registers_are_written_again() -> None:
    servo = servo1()
    wrote(servo, torque_enable=1)
    servo.jam(True, 0.0)
    wrote(servo, goal_position=4000)
    answers = [servo.read(24, 1, 0.05 * step) for step in range(60)]
    assert answers[2] == (0, b"\1") and answers[-1] == (Error1.OVERLOAD, b"\0")
    servo.jam(False, 3.0)
    assert write_register(servo, "goal_position", 3000, 3.0) == Error1.OVERLOAD  # a goal does not undo it
    assert shown(servo, 3.0, "torque_enable", "torque_limit") == (0, 0)
    wrote(servo, 3.0, torque_limit=1023, torque_enable=1)
    assert read_register(servo, "present_position", 6.0) == 3000


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
    assert answered(servo, Instruction.WRITE, bytes((address,)) + data) == (error, b"")
    assert bytes(servo.memory.image) == before


def test_instructions_registered_writes_the_lock_a_reset_and_the_status_return_level() -> None:
    servo = servo1()
    for code in (Instruction.REBOOT, Instruction.CLEAR, 0x84, Instruction.SYNC_READ, Instruction.ACTION):
        assert answered(servo, code) == (Error1.INSTRUCTION, b"")
    assert answered(servo, Instruction.REG_WRITE, b"\x19\1") == (0, b"")
    assert shown(servo, 0.0, "registered", "led") == (1, 0)
    assert answered(servo, Instruction.ACTION) == (0, b"")
    assert shown(servo, 0.0, "registered", "led") == (0, 1)
    wrote(servo, id=5, lock=1)
    assert {write_register(servo, name, value) for name, value in (("id", 6), ("lock", 0))} == {Error1.RANGE}
    assert servo.id == 5
    assert answered(servo, Instruction.FACTORY_RESET) == (0, b"")
    assert servo.id == 1 and servo.booting(0.1)
    servo.write(16, b"\0", 1.0)
    assert servo.execute(Instruction.READ, b"\x24\2", 1.0, broadcast=False) is None
    assert answered(servo, Instruction.PING, b"", 1.0) == (0, b"") and not servo.answers_reads


def test_moving_speed_slows_down_and_limits_make_a_wheel_or_many_turns() -> None:
    slow, wheel, turns = servo1(position=0.0), servo1(), servo1()
    wrote(slow, moving_speed=100, torque_enable=1, goal_position=4000)  # 11.4 rpm
    position, speed = shown(slow, 2.0, "present_position", "present_speed")
    assert position == pytest.approx(2 * 11.4 / 60 * 4096, rel=0.08) and speed == pytest.approx(100, abs=1)
    wrote(wheel, ccw_angle_limit=0, torque_enable=1, moving_speed=-200)
    assert read_register(wheel, "present_speed", 1.0) == -200
    wrote(turns, cw_angle_limit=4095, torque_enable=1, goal_position=9000)
    assert read_register(turns, "present_position", 20.0) == 9000
