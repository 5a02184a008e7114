"""Emulated servos for tests; registers are written and read by instructions."""

from hardware.dynamixel.codec import Instruction
from hardware.dynamixel.control_table import find_table
from hardware.servo import find_model
from sim.emulator.device import Answer
from sim.emulator.servo1 import EmulatedServo1
from sim.emulator.servo2 import EmulatedServo
from sim.emulator.servo_body import ServoBuild

Servo = EmulatedServo | EmulatedServo1


def servo2(model: str = "XM430-W350", *, position: float = 2048.0, firmware: int | None = None) -> EmulatedServo:
    """A 2.0 servo at time 0."""
    return EmulatedServo(find_table(model, 2, firmware), find_model(model), ServoBuild(position))


def servo1(model: str = "MX-28", *, position: float = 2048.0) -> EmulatedServo1:
    """A 1.0 servo at time 0."""
    return EmulatedServo1(find_table(model, 1), find_model(model), ServoBuild(position))


def write_register(servo: Servo, name: str, value: int, now: float = 0.0) -> int:
    """Write a register by an instruction; return the error byte."""
    register = servo.table[name]
    params = register.address.to_bytes(servo.protocol, "little") + register.encode(value)
    return answered(servo, Instruction.WRITE, params, now).error


def wrote(servo: Servo, now: float = 0.0, **values: int) -> None:
    """Write registers in this order; none may be refused."""
    for name, value in values.items():
        assert write_register(servo, name, value, now) == 0, name


def read_register(servo: Servo, name: str, now: float = 0.0) -> int:
    """Read a register."""
    register = servo.table[name]
    return register.decode(servo.read(register.address, register.size, now).data)


def shown(servo: Servo, now: float, *names: str) -> tuple[int, ...]:
    """What these registers show at a time, s."""
    return tuple(read_register(servo, name, now) for name in names)


def answered(servo: Servo, instruction: int, params: bytes = b"", now: float = 0.0) -> Answer:
    """Send an instruction to a servo, which must answer."""
    answer = servo.execute(instruction, params, now, broadcast=False)
    assert answer is not None
    return answer
