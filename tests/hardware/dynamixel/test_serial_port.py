"""A real tty as a port, on pseudo-terminals."""

import errno
import os
import select
import termios
import tty
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import Mock

import pytest
from serial import Serial

from bus_rig import BusRig, specs
from hardware.clock import MonotonicClock
from hardware.dynamixel import serial_port
from hardware.dynamixel.opening import examine
from hardware.dynamixel.serial_port import ECHOES, SerialPort, real_baud
from hardware.errors import BusError
from hardware.joint_map import JointMap
from messages import refuses, shows
from sim.emulator.faults import Fault, FaultKind


@pytest.mark.parametrize(("model", "protocol"), [("XM430-W350", 2), ("MX-28", 1), ("AX-12A", 1)])
@pytest.mark.parametrize("echo", [False, True])
@pytest.mark.parametrize("silent", [False, True])
def test_opening_notes_it_once(model: str, protocol: int, echo: bool, silent: bool) -> None:
    rig = BusRig(specs(2, model), protocol=protocol, baud=1_000_000)
    rig.port.open(1_000_000)
    if echo:
        rig.fault(Fault(FaultKind.ECHO))
    if silent:
        rig.fault(Fault(FaultKind.MISSING))
    (line,) = rig.bus.lines
    opening = examine(line, JointMap(rig.servos))
    count = sum(ECHOES in note for note in opening.notes)
    assert count == (1 if echo else 0) or (silent and protocol == 1)
    assert bool(opening.problems) is silent


def test_the_latency_timer_is_read_through_links(tmp_path: Path) -> None:
    (tmp_path / "ttyUSB0").mkdir()
    (tmp_path / "ttyUSB0" / "latency_timer").write_text("16\n")
    link = tmp_path / "by-id-ftdi"
    link.symlink_to("/dev/ttyUSB0")
    assert serial_port.latency_timer_ms("/dev/ttyUSB0", tmp_path) == 16
    assert serial_port.latency_timer_ms(str(link), tmp_path) == 16
    assert serial_port.timer_command(str(link), tmp_path) == (f"echo 1 | sudo tee {tmp_path}/ttyUSB0/latency_timer")


@pytest.mark.parametrize("failure", [None, ValueError("no ioctl"), OSError(5, "gone"), NotImplementedError()])
def test_the_kernel_is_asked_first(failure: Exception | None) -> None:
    class Line(Serial):  # type: ignore[misc]  # pyserial has no types
        asked = False

        def set_low_latency_mode(self, wanted: bool) -> None:
            Line.asked = wanted
            if failure is not None:
                raise failure

    assert serial_port.request_low_latency(Line()) == (failure is None)
    assert Line.asked


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ((errno.ENOENT, errno.ENXIO, errno.EIO), "no such port"),
        ((errno.EBUSY, errno.EAGAIN), "busy"),
        ((errno.EACCES, errno.EPERM), "dialout"),
        ((errno.ENOTTY,), "not a serial port"),
    ],
)
def test_a_number_becomes_words(numbers: tuple[int, ...], words: str) -> None:
    for number in numbers:
        error = serial_port.why_not_open("/dev/ttyUSB0", 57_600, OSError(number, os.strerror(number)))
        assert words in str(error) and "/dev/ttyUSB0" in str(error)


def test_the_owner_of_a_port_is_named() -> None:
    for path in (os.devnull, "/dev/none"):
        shows(str(serial_port.why_not_open(path, 57_600, PermissionError(errno.EACCES, "no"))))


def test_the_process_that_holds_a_port_is_named_with_its_command_line(tmp_path: Path) -> None:
    device, other = tmp_path / "tty", tmp_path / "other"
    device.touch()
    other.touch()
    processes = tmp_path / "proc"
    for number, command, held in (
        (12, "bin/python bin/retarget servo monitor --robot op3", [device]),
        (13, "retarget run", [other]),
        (14, "screen tty", [other, device]),
    ):
        process = processes / str(number)
        (process / "fd").mkdir(parents=True)
        for at, target in enumerate(held):
            (process / "fd" / str(at)).symlink_to(target)
        (process / "cmdline").write_text(command.replace(" ", "\0") + "\0")
    (processes / "15").mkdir()
    found = serial_port.holders(str(device), processes)
    assert sorted(found.split(", ")) == ["process 12 (retarget servo monitor --robot op3)", "process 14 (screen tty)"]
    assert serial_port.holders(str(tmp_path / "none"), processes) == "another process"


def test_a_real_pseudo_terminal_knows_its_other_end() -> None:
    master, client = os.openpty()
    try:
        text = serial_port.holders(os.ttyname(client))
    finally:
        os.close(client)
        os.close(master)
    assert text.startswith(f"another process; process {os.getpid()} (") and text.endswith(") is its other end")


SOON = 2.0
"""[s] Bound for what comes at once."""


@dataclass
class Pty:
    """Both ends of a line; the far one plays the servos."""

    far: int
    near: int
    path: str

    def hang_up(self) -> None:
        if self.far >= 0:
            os.close(self.far)
            os.close(self.near)
        self.far = -1


@pytest.fixture
def pty() -> Iterator[Pty]:
    far, near = os.openpty()
    tty.setraw(far)
    tty.setraw(near)
    line = Pty(far, near, os.ttyname(near))
    yield line
    line.hang_up()


@pytest.fixture
def port(pty: Pty) -> Iterator[SerialPort]:
    port = SerialPort(pty.path, MonotonicClock())
    port.open(1_000_000)
    yield port
    port.close()


@pytest.mark.parametrize("baud", [9_600, 57_600, 1_000_000, 4_000_000, 4_500_000, 10_500_000])
def test_any_speed(pty: Pty, port: SerialPort, baud: int) -> None:
    port.set_baud(baud)
    assert real_baud(pty.near) == port.baud == baud
    port.open(baud)
    assert real_baud(pty.near) == port.baud == baud


@pytest.mark.parametrize("baud", [-1, 0, 300, 20_000_000, 10**12])
def test_a_speed_that_does_not_exist_leaves_the_old_one(pty: Pty, port: SerialPort, baud: int) -> None:
    with refuses(BusError):
        port.set_baud(baud)
    assert real_baud(pty.near) == port.baud == 1_000_000
    with refuses(BusError):
        SerialPort(pty.path, MonotonicClock()).open(baud)


def test_a_driver_that_falls_back_is_found_out(pty: Pty, port: SerialPort, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hardware.dynamixel.serial_port.real_baud", lambda fd: 9_600)
    with refuses(BusError, 9600):
        port.set_baud(3_000_000)
    assert real_baud(pty.near) == port.baud == 1_000_000
    with refuses(BusError, 9600):
        port.open(3_000_000)
    with refuses(BusError):
        port.read()


def test_waiting_ends_at_the_deadline_and_what_had_arrived_can_be_dropped(pty: Pty, port: SerialPort) -> None:
    start = port.now()
    assert not port.wait(start + 0.02)
    assert start + 0.019 <= port.now() < start + SOON
    assert not port.wait(start)
    for dropping in (port.drop, lambda: port.set_baud(57_600)):
        os.write(pty.far, b"stale")
        assert port.wait(port.now() + SOON)
        dropping()
        assert port.read() == b""
    with refuses(BusError):  # an adapter that takes no bytes
        port.write(bytes(20_000))


def test_a_second_process_is_refused_a_busy_port(pty: Pty, port: SerialPort) -> None:
    second = SerialPort(pty.path, MonotonicClock())
    with refuses(BusError, os.getpid()):
        second.open(57_600)
    assert real_baud(pty.near) == 1_000_000
    port.close()
    second.open(57_600)
    second.close()


def uses(port: SerialPort) -> list[Callable[[], object]]:
    return [port.read, port.drop, lambda: port.write(b"x"), lambda: port.set_baud(57_600)]


def test_closing_twice_and_using_it_then(pty: Pty, port: SerialPort) -> None:
    port.close()
    port.close()
    SerialPort(pty.path, MonotonicClock()).close()
    with refuses(BusError):
        port.wait(0.0)
    for use in uses(port):
        with refuses(BusError):
            use()


def test_unplugged_while_open(pty: Pty, port: SerialPort) -> None:
    pty.hang_up()
    assert port.wait(port.now() + SOON)
    for use in uses(port):
        with refuses(BusError):
            use()
    port.close()
    with refuses(BusError):
        port.open(57_600)


def test_the_end_of_a_line_that_reads_as_nothing(port: SerialPort, monkeypatch: pytest.MonkeyPatch) -> None:
    """A USB adapter that is pulled out: reads bring nothing, and the poll says that they always will."""
    assert port.read() == b""

    class HungUp:
        def register(self, fd: int, events: int) -> None: ...

        def poll(self, timeout: int) -> list[tuple[int, int]]:
            return [(0, select.POLLHUP)]

    monkeypatch.setattr(select, "poll", HungUp)
    with refuses(BusError):
        port.read()


def test_paths_that_are_no_port(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_bytes(b"")
    for path in (tmp_path / "none", file / "below", "", file, tmp_path, os.devnull, "a\0b"):
        with refuses(BusError):
            SerialPort(str(path), MonotonicClock()).open(57_600)


@pytest.mark.parametrize("failure", [PermissionError(errno.EACCES, "x"), termios.error(errno.EPERM, "x")])
def test_without_permission_the_fix_is_named(pty: Pty, monkeypatch: pytest.MonkeyPatch, failure: Exception) -> None:
    monkeypatch.setattr("hardware.dynamixel.serial_port.Serial.__init__", Mock(side_effect=failure))
    with refuses(BusError, "usermod"):
        SerialPort(pty.path, MonotonicClock()).open(57_600)
