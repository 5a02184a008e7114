"""Emulated servos for tests; registers are written and read by instructions."""

import os
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from hardware.clock import MonotonicClock
from hardware.dynamixel.codec import Instruction, protocol2
from hardware.dynamixel.control_table import code_of, find_table
from hardware.servo import find_model
from retarget import cli
from sim.emulator.device import Answer, Device
from sim.emulator.fault_state import FaultState
from sim.emulator.line import REAL_TIME_GAP, Line, LineTiming
from sim.emulator.ports import Link, PseudoTerminal, serve
from sim.emulator.servo1 import EmulatedServo1
from sim.emulator.servo2 import EmulatedServo
from sim.emulator.servo2_registers import BusWatchdog
from sim.emulator.servo_body import ServoBuild

Servo = EmulatedServo | EmulatedServo1


def servo2(model: str = "XM430-W350", *, position: float = 2048.0, firmware: int | None = None) -> EmulatedServo:
    """A 2.0 servo at time 0."""
    return EmulatedServo(find_table(model, 2, firmware), find_model(model), ServoBuild(position))


def numbered(number: int = 1, *, baud: int = 57600, return_delay: float = 0.0, position: float = 0.0) -> EmulatedServo:
    """A 2.0 servo with an id, bits/s and s before every status, for tests of a line."""
    servo = servo2(position=position)
    code = code_of(servo.table, baud)
    assert code is not None
    for name, value in (("id", number), ("baud_rate", code), ("return_delay_time", round(return_delay / 2e-6))):
        servo.memory.put(name, value)
    servo.tune()
    return servo


PING, STATUS = protocol2.ping(1), protocol2.status(1, 0, b"\xfc\x03\x34")
"""To and from `numbered()`."""


def servo1(model: str = "MX-28", *, position: float = 2048.0) -> EmulatedServo1:
    """A servo of the older layout at time 0."""
    found = find_model(model)
    return EmulatedServo1(find_table(model, min(found.protocols)), found, ServoBuild(position))


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


# Devices served on a pseudo-terminal by a thread, for clients of their own.

NO_DELAY = replace(LineTiming.none(), gap=REAL_TIME_GAP)


@contextmanager
def serving(terminal: PseudoTerminal) -> Iterator[None]:
    """Serve a terminal while the context lasts."""
    wake, poke = os.pipe()
    stop = threading.Event()
    listen = {wake: lambda: bool(os.read(wake, 1))}
    thread = threading.Thread(target=lambda: serve([terminal], MonotonicClock(), until=stop.is_set, listen=listen))
    before = sys.getswitchinterval()
    sys.setswitchinterval(2e-4)  # a client that spins would keep the thread waiting for 5 ms each time
    terminal.open()
    thread.start()
    try:
        yield
    finally:
        stop.set()
        os.write(poke, b"x")
        thread.join(5.0)
        sys.setswitchinterval(before)
        terminal.close()
        os.close(wake)
        os.close(poke)
        assert not thread.is_alive()


@contextmanager
def served(devices: Sequence[Device], path: Path, timing: LineTiming = NO_DELAY) -> Iterator[Line]:
    """Serve devices on `path` while the context lasts."""
    line = Line(devices, timing=timing, faults=FaultState(devices, origin=MonotonicClock().now()))
    with serving(PseudoTerminal(line, Link(path))):
        yield line


# `retarget emulate`, and a log of what its client sends and of bus watchdogs that stop a servo: first word FILE.


def main(log: str, *words: str) -> None:
    """Emulate until a signal ends it."""
    receive, trip = Line.receive, BusWatchdog.trip
    with Path(log).open("w", buffering=1, encoding="ascii") as out:

        def received(self: Line, data: bytes, now: float) -> None:
            out.write(f"heard {now!r} {data.hex()}\n")
            receive(self, data, now)

        def tripped(self: BusWatchdog) -> None:
            out.write(f"tripped {self.deadline!r}\n")
            trip(self)

        Line.receive, BusWatchdog.trip = received, tripped  # type: ignore[method-assign]
        cli.main(["emulate", *words])


if __name__ == "__main__":
    main(*sys.argv[1:])
