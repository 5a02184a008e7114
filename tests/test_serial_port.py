"""A real tty as a port, on pseudo-terminals."""

import errno
import os
import termios
import tty
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from hardware.clock import MonotonicClock
from hardware.dynamixel import port_trouble
from hardware.dynamixel.byte_port import BytePort
from hardware.dynamixel.serial_port import SerialPort, real_baud
from hardware.errors import BusError
from support.messages import refuses

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


def test_it_is_a_byte_port(pty: Pty, port: SerialPort) -> None:
    as_port: BytePort = port
    assert as_port.name == pty.path


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


def test_bytes_both_ways_as_they_are(pty: Pty, port: SerialPort) -> None:
    every = bytes(range(256))
    port.write(every)
    assert os.read(pty.far, 1000) == every
    os.write(pty.far, every)
    assert port.wait(port.now() + SOON)
    assert port.read() == every
    assert port.read() == b""


def test_waiting_ends_at_the_deadline_and_not_before(port: SerialPort) -> None:
    start = port.now()
    assert not port.wait(start + 0.02)
    assert start + 0.019 <= port.now() < start + SOON
    assert not port.wait(start)


def test_waiting_takes_no_processor_time(port: SerialPort) -> None:
    before = os.times()
    port.wait(port.now() + 0.1)
    after = os.times()
    assert (after.user + after.system) - (before.user + before.system) <= 0.05


def test_what_had_arrived_can_be_dropped(pty: Pty, port: SerialPort) -> None:
    os.write(pty.far, b"stale")
    assert port.wait(port.now() + SOON)
    port.drop()
    assert port.read() == b""
    os.write(pty.far, b"stale")
    assert port.wait(port.now() + SOON)
    port.set_baud(57_600)
    assert port.read() == b""


def test_a_second_one_is_told_that_the_port_is_busy(pty: Pty, port: SerialPort) -> None:
    second = SerialPort(pty.path, MonotonicClock())
    with refuses(BusError, os.getpid()):
        second.open(57_600)
    assert real_baud(pty.near) == 1_000_000
    port.close()
    second.open(57_600)
    second.close()


def test_opened_through_a_link(pty: Pty, tmp_path: Path) -> None:
    link = tmp_path / "usb-adapter"
    link.symlink_to(pty.path)
    port = SerialPort(str(link), MonotonicClock())
    port.open(57_600)
    assert port.name == str(link)
    port.close()


def test_closing_twice_and_using_it_then(pty: Pty, port: SerialPort) -> None:
    port.close()
    port.close()
    SerialPort(pty.path, MonotonicClock()).close()
    for use in (port.read, port.drop, lambda: port.write(b"x"), lambda: port.wait(0.0), lambda: port.set_baud(57_600)):
        with refuses(BusError):
            use()


def test_unplugged_while_open(pty: Pty, port: SerialPort) -> None:
    pty.hang_up()
    assert port.wait(port.now() + SOON)
    for use in (port.read, port.drop, lambda: port.write(b"x"), lambda: port.set_baud(57_600)):
        with refuses(BusError):
            use()
    port.close()
    with refuses(BusError):
        port.open(57_600)


def test_the_end_of_a_line_that_reads_as_nothing(port: SerialPort, monkeypatch: pytest.MonkeyPatch) -> None:
    """A USB adapter that is pulled out: reads bring nothing, and the poll says that they always will."""
    assert port.read() == b""
    monkeypatch.setattr(SerialPort, "_hung_up", lambda self, fd: True)
    with refuses(BusError):
        port.read()


def test_an_adapter_that_takes_no_bytes(port: SerialPort) -> None:
    with refuses(BusError):
        port.write(bytes(20_000))


def test_paths_that_are_no_port(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_bytes(b"")
    for path, facts in [
        (str(tmp_path / "none"), ()),
        (str(file / "below"), ()),
        ("", ()),
        (str(file), ()),
        (str(tmp_path), ()),
        (os.devnull, ()),
        ("a\0b", ()),
    ]:
        with refuses(BusError, facts):
            SerialPort(path, MonotonicClock()).open(57_600)


def test_a_missing_port_lists_those_that_exist(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(port_trouble, "comports", lambda: [type("Port", (), {"device": "/dev/ttyUSB7"})])
    assert "/dev/ttyUSB7" in str(port_trouble.no_such_port("/dev/ttyUSB0"))
    monkeypatch.setattr(port_trouble, "comports", list)
    assert "no serial port exists" in str(port_trouble.no_such_port("/dev/ttyUSB0"))


@pytest.mark.parametrize("failure", [PermissionError(errno.EACCES, "x"), termios.error(errno.EPERM, "x")])
def test_without_permission_the_fix_is_named(pty: Pty, monkeypatch: pytest.MonkeyPatch, failure: Exception) -> None:
    def refuse(self: object, **settings: object) -> None:
        raise failure

    monkeypatch.setattr("hardware.dynamixel.serial_port.Serial.__init__", refuse)
    with refuses(BusError, "usermod"):
        SerialPort(pty.path, MonotonicClock()).open(57_600)
