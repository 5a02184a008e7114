"""OP3 from the box to the first wave: twenty new servos are set up, homed, scanned and followed, on the same emulated
servos throughout, by the command lines of docs/op3.md. Time is virtual."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from hardware.clock import VirtualClock
from hardware.dynamixel import serial_port
from messages import shows
from retarget.cli import main, run
from retarget.cli.buses import posture_ticks
from retarget.cli.servo import home, places
from retarget.model.robot import load_robot, load_uncalibrated
from sim.emulator.ports import EmulatedPort
from sim.emulator.robot_lines import connect, robot_lines

PAGE = Path(__file__).resolve().parents[3] / "docs" / "op3.md"
PORT = "/dev/ttyUSB0"
OFF = {0: 30, 19: -12}
"""Ticks by which the horns of two servos are off the profile's zero."""


class Bench:
    """Twenty servos in their cartons, and a person who connects the one that is asked for, then all of them."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self.clock, body = VirtualClock(), load_uncalibrated("op3")
        self.servos, self._capsys = body.joint_map.servos, capsys
        start = posture_ticks(body, "neutral")
        for column, ticks in OFF.items():
            start[column] += ticks
        self.lines = robot_lines(
            self.servos, body.profile.bus_specs(), start=start, now=0.0, powered=True, as_delivered=True
        )
        (self.line,) = self.lines.values()
        for module in (places, home, run):
            monkeypatch.setattr(module, "MonotonicClock", lambda: self.clock)
        for module in (places, serial_port):
            monkeypatch.setattr(module, "SerialPort", self._port)
        monkeypatch.setattr("builtins.input", self._answer)

    def _port(self, name: str, clock: object) -> EmulatedPort:
        assert (name, clock) == (PORT, self.clock)
        return EmulatedPort(self.line, self.clock, name=name)

    def _answer(self, question: str) -> str:
        if asked := re.match(r"\[\d+/20\] (\w+): connect its \S+ alone", question):
            connect(self.lines, self.servos, (asked[1],))
            return ""
        return "" if question.startswith("Read") or "[Y/n]" in question else "y"

    def connect_all(self) -> None:
        connect(self.lines, self.servos, [servo.joint for servo in self.servos])

    def types(self, line: str) -> str:
        """The output of a command line, which ends well."""
        with pytest.raises(SystemExit) as left:
            main(line.split()[1:])
        out, err = self._capsys.readouterr()
        assert left.value.code == 0, out + err
        return out


@pytest.fixture
def documented() -> Callable[[str], str]:
    """The command line of the page that begins so, with the port that this test has."""
    lines = re.findall(r"^ +(retarget .+)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)

    def line(begins: str) -> str:
        found = next(one for one in lines if one.startswith(begins))
        return found.replace("--bus profile", f"--bus {PORT}") if "--bus" in found else f"{found} --port {PORT}"

    return line


def test_twenty_new_servos_follow_the_sample_at_the_end(
    documented: Callable[[str], str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    bench = Bench(monkeypatch, capsys)
    assert {device.id for device in bench.line.devices[:20]} == {1}

    out = bench.types(documented("retarget servo setup"))
    shows(out.splitlines()[-1], "20 servos")
    assert [device.id for device in bench.line.devices[:20]] == [servo.id for servo in bench.servos]

    bench.connect_all()
    out = bench.types(documented("retarget servo scan"))
    shows(out.splitlines()[-1])
    assert all(re.search(rf"\b{servo.joint}\b", out) for servo in bench.servos)

    out = bench.types(documented("retarget servo home"))
    assert "+0.046" in out and "-0.018" in out
    zeros = {index: servo.zero_tick for index, servo in enumerate(load_robot("op3").joint_map.servos)}
    assert all(zeros[column] == bench.servos[column].zero_tick + ticks for column, ticks in OFF.items())

    out = bench.types(documented("retarget run") + " --end 2")
    shows(out.splitlines()[-1], "op3")
    assert not any(device.memory.value("torque_enable") for device in bench.line.devices[:20])
    assert bench.clock.now() > 2.0
