"""Emulated servos for tests; registers are written and read by instructions."""

from hardware.dynamixel.codec import Instruction
from hardware.dynamixel.control_table import find_table
from hardware.servo import find_model
from sim.emulator.device import Answer
from sim.emulator.servo1 import EmulatedServo1
from sim.emulator.servo2 import EmulatedServo
from sim.emulator.servo_body import ServoBuild


def servo2(model: str = "XM430-W350", *, position: float = 2048.0, firmware: int | None = None) -> EmulatedServo:
    """A 2.0 servo at time 0."""
    return EmulatedServo(find_table(model, 2, firmware), find_model(model), ServoBuild(position))


def servo1(model: str = "MX-28", *, position: float = 2048.0) -> EmulatedServo1:
    """A 1.0 servo at time 0."""
    return EmulatedServo1(find_table(model, 1), find_model(model), ServoBuild(position))


def write_register(servo: EmulatedServo, name: str, value: int, now: float = 0.0) -> int:
    """Write a register of a 2.0 servo by an instruction; return the error byte."""
    register = servo.table[name]
    params = register.address.to_bytes(2, "little") + register.encode(value)
    return answered(servo, Instruction.WRITE, params, now).error


def read_register(servo: EmulatedServo, name: str, now: float = 0.0) -> int:
    """Read a register of a 2.0 servo."""
    register = servo.table[name]
    return register.decode(servo.read(register.address, register.size, now).data)


def answered(servo: EmulatedServo, instruction: int, params: bytes = b"", now: float = 0.0) -> Answer:
    """Send an instruction to a 2.0 servo, which must answer."""
    answer = servo.execute(instruction, params, now, broadcast=False)
    assert answer is not None
    return answer


def write_register1(servo: EmulatedServo1, name: str, value: int, now: float = 0.0) -> int:
    """Write a register of a 1.0 servo by an instruction; return the error byte."""
    register = servo.table[name]
    params = bytes((register.address,)) + register.encode(value)
    answer = servo.execute(Instruction.WRITE, params, now, broadcast=False)
    assert answer is not None
    return answer.error


def read_register1(servo: EmulatedServo1, name: str, now: float = 0.0) -> int:
    """Read a register of a 1.0 servo."""
    register = servo.table[name]
    return register.decode(servo.read(register.address, register.size, now).data)
