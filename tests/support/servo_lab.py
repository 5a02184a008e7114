"""`retarget servo` as a user runs it: the command line, what is typed, and the emulated servos behind it."""

import io
from pathlib import Path

import pytest

from hardware.clock import Clock
from retarget.cli import main
from retarget.cli.servo import places
from retarget.model.robot import RobotBody
from sim.emulator.faults import Fault
from sim.emulator.line import Line
from sim.emulator.memory import Memory


class ServoLab:
    """The emulated OP3. before: registers as they are to be when a command begins, counts by (id, name)."""

    def __init__(self, patch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self._patch, self._capsys = patch, capsys
        self._make = places.emulated_lines
        self.before: dict[tuple[int, str], int] = {}
        self.models: dict[int, int] = {}
        """Model numbers by id, where a servo is to be of an unknown model."""
        self.moved: dict[int, int] = {}
        """New ids by id."""
        self.faults: list[Fault] = []
        self.upon: dict[int, Fault] = {}
        """Faults that begin when an instruction (2.0) has gone over the line."""
        self.sent: list[bytes] = []
        self.bauds: list[int] = []
        """Speed of the port, bits/s, at each of `sent`."""
        self.lines: dict[str, Line] = {}
        patch.setattr(places, "emulated_lines", self._lines)
        patch.setenv("COLUMNS", "200")

    def _lines(
        self, body: RobotBody, clock: Clock, faults: Path | None, *, as_delivered: bool = False
    ) -> dict[str, Line]:
        self.lines = self._make(body, clock, faults, as_delivered=as_delivered)
        for (device, name), value in self.before.items():
            self.write_register(device, name, value)
        for device, number in self.models.items():
            self.memory(device).put("model_number", number)
        for device, other in self.moved.items():
            servo = next(one for one in self.line.devices if one.id == device)
            self.memory(device).put("id", other)
            servo.tune()
        line = self.line
        for fault in self.faults:
            line.faults.add(fault, clock.now())
        receive = line.receive

        def received(data: bytes, now: float) -> None:
            self.sent.append(data)
            self.bauds.append(line.baud)
            receive(data, now)
            if len(data) > 7 and data[7] in self.upon:
                line.faults.add(self.upon.pop(data[7]), now)

        self._patch.setattr(line, "receive", received)
        return self.lines

    @property
    def line(self) -> Line:
        """The only one of an OP3."""
        return next(iter(self.lines.values()))

    def memory(self, device: int) -> Memory:
        """Of the servo that has this id now."""
        servo = next(one for one in self.line.devices if one.id == device)
        memory: Memory = servo.memory
        return memory

    def write_register(self, device: int, name: str, value: int) -> None:
        """Write a register, as an instruction would."""
        servo = next(one for one in self.line.devices if one.id == device)
        register = self.memory(device).table[name]
        servo.write(register.address, register.encode(value), 0.0)

    def run(self, *words: str, typed: str = "") -> tuple[int, str, str]:
        """Exit code, stdout and stderr of `retarget servo WORDS`."""
        self._patch.setattr("sys.stdin", io.StringIO(typed))
        with pytest.raises(SystemExit) as left:
            main(["servo", *words])
        out, err = self._capsys.readouterr()
        return int(left.value.code or 0), out, err

    def instructions(self) -> set[int]:
        """Instructions of protocol 2.0 that went over the line."""
        return {data[7] for data in self.sent if data[:4] == b"\xff\xff\xfd\x00"}
