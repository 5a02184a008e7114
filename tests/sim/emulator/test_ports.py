"""Ports to emulated devices: the link and its reservation, a port in this process, pseudo-terminals, serving them."""

import array
import fcntl
import os
import select
import termios
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import Mock

import pytest
from serial import Serial

from emulated import PING, STATUS, numbered, serving
from hardware.clock import MonotonicClock, VirtualClock
from hardware.dynamixel.serial_port import BytePort
from hardware.errors import BusError, HardwareError
from messages import refuses
from retarget.errors import UsageError
from sim.emulator.fault_state import FaultState
from sim.emulator.faults import Fault, FaultKind
from sim.emulator.line import Line, LineTiming
from sim.emulator.ports import EmulatedPort, Link, PseudoTerminal, serve


def test_a_link_is_made_moved_and_removed(tmp_path: Path) -> None:
    link = Link(tmp_path / "servos")
    link.path.symlink_to("/dev/pts/99999")  # an emulator that was killed left it
    for target in ("/dev/pts/71", "/dev/pts/72"):
        link.point(target)
        assert link.path.readlink() == Path(target)
        assert list(tmp_path.iterdir()) == [link.path]
    link.remove()
    link.remove()
    assert list(tmp_path.iterdir()) == []
    link.point("/dev/pts/71")
    link.path.unlink()
    link.path.symlink_to("/dev/pts/72")
    link.remove()
    assert link.path.readlink() == Path("/dev/pts/72")  # it was moved, so it stays


def test_the_link_of_a_living_emulator_is_left_to_it(tmp_path: Path) -> None:
    first, second = _terminal(tmp_path / "servos"), _terminal(tmp_path / "servos")
    first.open()
    with refuses(UsageError, found=first.path, varies=first.path):
        second.open()
    assert first.link.path.readlink() == Path(first.path) and second.fd == -1
    first.close()
    second.open()
    assert second.link.path.readlink() == Path(second.path)
    second.close()


@pytest.mark.parametrize("kind", ["file", "folder", "link", "dangling"])
def test_a_link_replaces_nothing_else(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "servos"
    if kind == "file":
        path.write_text("mine")
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to("/dev/null" if kind == "link" else tmp_path / "nowhere")
    before = path.lstat()
    with refuses(UsageError):
        Link(path).point("/dev/pts/3")
    after = path.lstat()
    assert (after.st_ino, after.st_mtime_ns, after.st_size) == (before.st_ino, before.st_mtime_ns, before.st_size)
    with refuses(UsageError):
        Link(tmp_path / "none" / "servos").check()


BAUD = 1_000_000


def test_a_ping_is_answered_after_wire_time_and_latency() -> None:
    clock = VirtualClock(5.0)
    port: BytePort = EmulatedPort(Line([numbered(baud=BAUD)]), clock)
    port.open(BAUD)
    port.write(PING)
    assert port.read() == b"" and port.wait(6.0)
    assert clock.now() == pytest.approx(5.0 + 10e-6 * (10 + 14) + 20e-6 + 1e-3)
    assert port.read() == STATUS and port.read() == b""
    assert not port.wait(6.25) and clock.now() == 6.25
    port.write(PING)
    assert not port.wait(6.2505) and port.wait(7.0)  # an answer behind the deadline is not there yet


def test_a_lost_adapter_raises_and_is_opened_again_when_it_is_back_and_a_port_is_used_while_it_is_open() -> None:
    clock, devices = VirtualClock(), [numbered(baud=BAUD)]
    state = FaultState(devices, faults=[Fault(FaultKind.UNPLUG, start=1.0, end=2.0)])
    port = EmulatedPort(Line(devices, faults=state), clock)
    port.open(BAUD)
    with refuses(BusError):
        while not port.wait(1.5):
            pass
    with refuses(BusError):
        port.open(BAUD)
    clock.sleep_until(2.5)
    port.open(BAUD)
    port.write(PING)
    assert port.wait(3.0) and port.read() == STATUS
    with refuses(BusError):
        port.open(57600)
    with refuses(BusError):
        port.set_baud(0)
    port.close()
    port.close()
    for use in (port.read, port.drop, lambda: port.write(b"x"), lambda: port.wait(1.0), lambda: port.set_baud(9600)):
        with refuses(BusError):
            use()


def _terminal(
    path: Path, *, timing: LineTiming | None = None, faults: tuple[Fault, ...] = (), origin: float = 0.0
) -> PseudoTerminal:
    """Three devices behind a link that is not made yet. timing: None: nothing takes time."""
    devices = [numbered(index, baud=BAUD) for index in (1, 2, 3)]
    state = FaultState(devices, faults=faults, origin=origin)
    return PseudoTerminal(Line(devices, timing=timing or LineTiming.none(), faults=state), Link(path))


@contextmanager
def _opened(terminal: PseudoTerminal, timeout: float = 0.5) -> Iterator[Serial]:
    """A client of a terminal that is open meanwhile."""
    terminal.open()
    try:
        with Serial(str(terminal.link.path), BAUD, timeout=timeout) as client:
            yield client
    finally:
        terminal.close()


def test_bytes_pass_as_they_are(tmp_path: Path) -> None:
    every, received, terminal = bytes(range(256)), list[bytes](), _terminal(tmp_path / "servos")
    terminal.line.receive = lambda data, now: received.append(data)  # type: ignore[method-assign]
    with _opened(terminal) as client:
        client.write(every)
        terminal.receive(0.0)
        os.write(terminal.fd, every)
        assert client.read(256) == every
    assert b"".join(received) == every


def test_a_client_may_come_again_even_after_it_locked_the_port(tmp_path: Path) -> None:
    terminal = _terminal(tmp_path / "servos")
    terminal.open()
    for _ in range(2):
        fd, exclusive = os.open(terminal.link.path, os.O_RDWR | os.O_NOCTTY), array.array("i", [1])
        try:
            fcntl.ioctl(fd, termios.TIOCEXCL)
            os.write(fd, b"x")
            terminal.receive(0.0)
            fcntl.ioctl(fd, 0x80045440, exclusive)  # TIOCGEXCL
            assert not exclusive[0]
        finally:
            os.close(fd)
    terminal.close()


def _pinged_twice(folder: Path, *, late: float, answered: float = 0.01) -> tuple[bytes, float]:
    """What a client receives that pings twice in 5 ms, from an emulator that is `late` s late and sends at `answered`,
    s; and by how much the emulator was too late, s."""
    terminal, held = _terminal(folder / "servos", timing=LineTiming()), array.array("i", [0])
    with _opened(terminal, timeout=0.05) as client:
        client.write(2 * PING)
        while held[0] < 2 * len(PING):
            select.select([terminal.fd], [], [], 1.0)
            fcntl.ioctl(terminal.fd, termios.FIONREAD, held)
        terminal.receive(0.005, late=late)
        terminal.send(answered)
        return bytes(client.read(2 * len(STATUS))), terminal.too_late


def test_a_client_that_does_not_wait_collides_but_a_late_emulator_damages_no_answer(tmp_path: Path) -> None:
    got, too_late = _pinged_twice(tmp_path, late=0.0)
    assert len(got) == len(STATUS) and got != STATUS and too_late == 0.0
    # The client had waited for the first answer; both requests waited for the emulator.
    assert _pinged_twice(tmp_path, late=0.005) == (2 * STATUS, 0.005)
    _, too_late = _pinged_twice(tmp_path, late=0.0, answered=1.0)
    assert too_late == pytest.approx(1.0 - 0.00626, abs=1e-4)


def test_a_machine_that_is_too_slow_is_named_and_seldom(tmp_path: Path) -> None:
    clock, turns, said = VirtualClock(0.0), iter(range(4)), list[str]()
    terminal = _terminal(tmp_path / "servos", timing=LineTiming())
    terminal.open()
    terminal.line.baud = BAUD

    def late_again() -> bool:
        terminal.line.receive(PING, clock.now())
        clock.advance(0.3)
        return next(turns, None) is None

    serve([terminal], clock, until=late_again, warn=said.append)
    terminal.close()
    assert said == ["this machine is too slow: the emulator was late by 299 ms"]


def test_where_there_is_no_pseudo_terminal_nothing_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "openpty", Mock(side_effect=OSError(28, "No space left on device")))
    with refuses(HardwareError):
        _terminal(tmp_path / "servos").open()
    assert list(tmp_path.iterdir()) == []


def test_a_plug_is_pulled_and_put_back_by_the_clock(tmp_path: Path) -> None:
    clock = MonotonicClock()
    unplug = Fault(FaultKind.UNPLUG, start=0.05, end=0.15)
    with serving(_terminal(tmp_path / "a", faults=(unplug,), origin=clock.now())):
        end = clock.now() + 5.0
        seen = [True]
        while len(seen) < 3 and clock.now() < end:
            there = os.path.lexists(tmp_path / "a")
            if there != seen[-1]:
                seen.append(there)
            clock.sleep_until(clock.now() + 0.005)
        assert seen == [True, False, True]
        with Serial(str(tmp_path / "a"), BAUD, timeout=2.0) as client:
            client.write(PING)
            assert client.read(len(STATUS)) == STATUS
