"""A line on a pseudo-terminal, as a client sees it that opens a serial port."""

import array
import fcntl
import os
import select
import termios
from collections.abc import Iterator
from pathlib import Path

import pytest
from serial import Serial

from hardware.dynamixel import protocol2
from hardware.errors import HardwareError
from retarget.errors import UsageError
from sim.emulator.fault_state import FaultState
from sim.emulator.faults import Fault, FaultKind
from sim.emulator.line import Line
from sim.emulator.link import Link
from sim.emulator.pseudo_terminal import PseudoTerminal
from sim.emulator.wire import Timing
from stub_devices import StubDevice
from support.messages import refuses

STATUS = protocol2.status(1, 0, b"\x06\x04\x26")


def _terminal(folder: Path, baud: int = 1_000_000, faults: tuple[Fault, ...] = ()) -> PseudoTerminal:
    devices = [StubDevice(baud=baud)]
    line = Line(devices, timing=Timing.none(), faults=FaultState(devices, faults=faults))
    terminal = PseudoTerminal(line, Link(folder / "servos"))
    terminal.open()
    return terminal


@pytest.fixture
def terminal(tmp_path: Path) -> Iterator[PseudoTerminal]:
    made = _terminal(tmp_path)
    yield made
    made.close()


def _exchange(terminal: PseudoTerminal, client: Serial, data: bytes, now: float = 0.0) -> bytes:
    client.write(data)
    assert select.select([terminal.fd], [], [], 1.0)[0]
    terminal.hear(now)
    terminal.speak(now)
    return bytes(client.read(len(STATUS)))


@pytest.mark.parametrize("baud", [57_600, 1_000_000, 4_000_000, 4_500_000])
def test_the_clients_own_speed_decides_who_hears_it(tmp_path: Path, baud: int) -> None:
    terminal = _terminal(tmp_path, baud)
    with Serial(str(terminal.link.path), baud, timeout=0.5, exclusive=True) as client:
        assert _exchange(terminal, client, protocol2.ping(1)) == STATUS
        assert terminal.line.baud == baud
        client.timeout = 0
        client.baudrate = 115_200
        assert _exchange(terminal, client, protocol2.ping(1)) == b""
    terminal.close()


def test_bytes_pass_as_they_are(terminal: PseudoTerminal) -> None:
    every = bytes(range(256))
    heard: list[bytes] = []
    terminal.line.hear = lambda data, now: heard.append(data)  # type: ignore[method-assign]
    with Serial(str(terminal.link.path), 1_000_000, timeout=0.5) as client:
        client.write(every)
        terminal.hear(0.0)
        os.write(terminal.fd, every)
        assert client.read(256) == every
    assert b"".join(heard) == every


def test_a_client_may_come_again_even_after_it_locked_the_port(terminal: PseudoTerminal) -> None:
    for _ in range(2):
        fd = os.open(terminal.link.path, os.O_RDWR | os.O_NOCTTY)
        try:
            fcntl.ioctl(fd, termios.TIOCEXCL)
            os.write(fd, b"x")
            terminal.hear(0.0)
            assert not _locked(fd)
        finally:
            os.close(fd)


def _locked(fd: int) -> bool:
    told = array.array("i", [0])
    fcntl.ioctl(fd, 0x80045440, told)  # TIOCGEXCL
    return bool(told[0])


def test_a_client_that_never_reads_costs_no_memory(terminal: PseudoTerminal) -> None:
    terminal.line.baud = 1_000_000
    with Serial(str(terminal.link.path), 1_000_000):
        for _ in range(6000):
            terminal.line.hear(protocol2.ping(1), 0.0)
            terminal.speak(0.0)
    assert terminal.lost > 0


def test_unplugged_it_is_gone_and_then_a_new_one_is_there(tmp_path: Path) -> None:
    terminal = _terminal(tmp_path, faults=(Fault(FaultKind.UNPLUG, start=1.0, end=2.0),))
    with Serial(str(terminal.link.path), 1_000_000, timeout=0.5) as client:
        assert _exchange(terminal, client, protocol2.ping(1)) == STATUS
        terminal.follow(1.0)
        assert terminal.fd == -1
        assert not os.path.lexists(terminal.link.path)
        with refuses(UsageError):
            Link(terminal.link.path).check()
        with pytest.raises(OSError):
            client.write(protocol2.ping(1))
    terminal.follow(2.0)
    with Serial(str(terminal.link.path), 1_000_000, timeout=0.5) as client:
        assert _exchange(terminal, client, protocol2.ping(1), 2.5) == STATUS
    terminal.close()
    assert list(tmp_path.iterdir()) == []


def test_where_there_is_no_pseudo_terminal_nothing_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def none_left() -> tuple[int, int]:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "openpty", none_left)
    with refuses(HardwareError):
        _terminal(tmp_path)
    assert list(tmp_path.iterdir()) == []
