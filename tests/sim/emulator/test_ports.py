"""Ports to emulated devices: the link and its reservation, a port in this process, pseudo-terminals, serving them."""

import array
import fcntl
import os
import select
import signal
import socket
import subprocess
import sys
import termios
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from serial import Serial

from hardware.clock import MonotonicClock, VirtualClock, thread_cpu
from hardware.dynamixel.codec import protocol2
from hardware.dynamixel.serial_port import BytePort
from hardware.errors import BusError, HardwareError
from messages import refuses
from retarget.errors import UsageError
from sim.emulator.fault_state import FaultState
from sim.emulator.faults import Fault, FaultKind
from sim.emulator.line import Line, Timing
from sim.emulator.ports import EmulatedPort, Link, PseudoTerminal, serve
from stub_devices import StubDevice


def test_the_path_counts_and_not_how_it_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "other").symlink_to("real")
    monkeypatch.chdir(tmp_path)
    first = Link(Path("real/servos"))
    first.check()
    first.check()
    for same in (tmp_path / "other" / ".." / "real" / "servos", tmp_path / "other" / "servos"):
        for _ in range(50):  # the holder can be asked for often
            with pytest.raises(UsageError, match=str(os.getpid())):
                Link(same).check()
    Link(tmp_path / "real" / "servos2").check()
    assert list((tmp_path / "real").iterdir()) == []
    first.remove()
    first.remove()
    Link(tmp_path / "other" / "servos").check()


def test_a_process_that_is_killed_has_nothing_any_more(tmp_path: Path) -> None:
    code = "import sys, signal; from pathlib import Path; from sim.emulator.ports import Link\n"
    code += "link = Link(Path(sys.argv[1])); print(link.check(), flush=True); signal.pause()"
    path = tmp_path / "servos"
    with subprocess.Popen([sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None and process.stdout.readline() == "None\n"
            link = Link(path)
            with pytest.raises(UsageError, match=str(process.pid)):
                link.check()
        finally:
            process.send_signal(signal.SIGKILL)
    link.check()


def test_it_is_made_moved_and_taken_away(tmp_path: Path) -> None:
    link = Link(tmp_path / "servos")
    for target in ("/dev/pts/71", "/dev/pts/72"):
        link.point(target)
        assert link.path.readlink() == Path(target)
        assert list(tmp_path.iterdir()) == [link.path]
    link.remove()
    link.remove()
    assert list(tmp_path.iterdir()) == []


def test_what_an_emulator_left_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "servos"
    path.symlink_to("/dev/pts/99999")
    Link(path).point("/dev/pts/3")
    assert path.readlink() == Path("/dev/pts/3")


def test_a_link_that_was_moved_stays(tmp_path: Path) -> None:
    link = Link(tmp_path / "servos")
    link.point("/dev/pts/71")
    link.path.unlink()
    link.path.symlink_to("/dev/pts/72")
    link.remove()
    assert link.path.readlink() == Path("/dev/pts/72")


def test_the_link_of_a_living_emulator_is_left_to_it(tmp_path: Path) -> None:
    first, second = Link(tmp_path / "servos"), Link(tmp_path / "servos")
    first.point("/dev/pts/71")
    for refused in (second.check, lambda: second.point("/dev/pts/72")):
        with refuses(UsageError, found=os.getpid()):
            refused()
    second.remove()
    assert first.path.readlink() == Path("/dev/pts/71")
    first.remove()
    second.point("/dev/pts/72")
    assert second.path.readlink() == Path("/dev/pts/72")


def test_a_link_that_is_hidden_is_still_of_its_emulator(tmp_path: Path) -> None:
    first, second = Link(tmp_path / "servos"), Link(tmp_path / "servos")
    first.point("/dev/pts/71")
    first.hide()
    assert list(tmp_path.iterdir()) == []
    with refuses(UsageError):
        second.check()
    first.point("/dev/pts/73")
    assert first.path.readlink() == Path("/dev/pts/73")


def test_a_path_that_cannot_be_reserved_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def none(*_: object) -> socket.socket:
        raise OSError(97, "Address family not supported by protocol")

    monkeypatch.setattr(socket, "socket", none)
    with refuses(UsageError):
        Link(tmp_path / "servos").check()


@pytest.mark.parametrize("kind", ["file", "folder", "link", "dangling"])
def test_nothing_else_is_ever_replaced(tmp_path: Path, kind: str) -> None:
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
    assert path.lstat() == before


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with refuses(UsageError):
        Link(tmp_path / "none" / "servos").check()


PING_STATUS = bytes.fromhex("FF FF FD 00 01 07 00 55 00 06 04 26 65 5D")


def _port(clock: VirtualClock, timing: Timing | None = None, baud: int = 1_000_000) -> EmulatedPort:
    port = EmulatedPort(Line([StubDevice(baud=1_000_000)], timing=timing), clock)
    port.open(baud)
    return port


def test_it_is_a_byte_port() -> None:
    port: BytePort = EmulatedPort(Line([]), VirtualClock(), name="line")
    assert port.name == "line"


def test_a_ping_is_answered_after_wire_time_and_latency() -> None:
    clock = VirtualClock(5.0)
    port = _port(clock)
    port.write(protocol2.ping(1))
    assert port.read() == b""
    assert port.wait(6.0)
    assert clock.now() == pytest.approx(5.0 + 10e-6 * (10 + 14) + 20e-6 + 1e-3)
    assert port.read() == PING_STATUS
    assert port.read() == b""


def test_waiting_for_nothing_ends_at_the_deadline() -> None:
    clock = VirtualClock()
    port = _port(clock)
    assert not port.wait(0.25)
    assert clock.now() == 0.25


def test_an_answer_behind_the_deadline_is_not_there_yet() -> None:
    clock = VirtualClock()
    port = _port(clock)
    port.write(protocol2.ping(1))
    assert not port.wait(0.0005)
    assert port.wait(1.0)


def test_without_wire_delay_the_answer_is_there_at_once() -> None:
    clock = VirtualClock(1.0)
    port = _port(clock, Timing.none())
    port.write(protocol2.ping(1))
    assert port.read() == PING_STATUS
    assert clock.now() == 1.0


def test_another_baud_rate_receives_nothing_until_it_is_right() -> None:
    clock = VirtualClock()
    port = _port(clock, baud=57600)
    port.write(protocol2.ping(1))
    assert not port.wait(1.0)
    port.set_baud(1_000_000)
    port.write(protocol2.ping(1))
    assert port.wait(2.0)
    assert port.baud == 1_000_000


def test_ports_on_one_clock_wait_for_each_other() -> None:
    clock = VirtualClock()
    first, second = _port(clock), _port(clock)
    first.write(protocol2.ping(1))
    second.write(protocol2.ping(1))
    assert first.wait(1.0)
    then = clock.now()
    assert second.wait(1.0)
    assert clock.now() == then
    assert first.read() == second.read() == PING_STATUS


def test_drop_forgets_what_has_arrived_and_not_what_is_coming() -> None:
    clock = VirtualClock()
    port = _port(clock)
    port.write(protocol2.ping(1))
    clock.advance(0.01)
    port.write(protocol2.ping(1))
    port.drop()
    assert port.wait(1.0)
    assert port.read() == PING_STATUS


def test_a_closed_port_refuses_everything_and_closes_twice() -> None:
    port = _port(VirtualClock())
    port.close()
    port.close()
    for use in (port.read, port.drop, lambda: port.write(b"x"), lambda: port.wait(1.0), lambda: port.set_baud(9600)):
        with refuses(BusError):
            use()


def test_it_is_opened_once_and_at_a_rate_above_zero() -> None:
    port = _port(VirtualClock())
    with refuses(BusError):
        port.open(57600)
    with refuses(BusError):
        port.set_baud(0)


def test_a_lost_adapter_raises_and_is_opened_again_when_it_is_back() -> None:
    clock = VirtualClock()
    devices = [StubDevice(baud=1_000_000)]
    state = FaultState(devices, faults=[Fault(FaultKind.UNPLUG, start=1.0, end=2.0)])
    port = EmulatedPort(Line(devices, faults=state), clock)
    port.open(1_000_000)
    with refuses(BusError):
        while not port.wait(1.5):
            pass
    with refuses(BusError):
        port.open(1_000_000)
    clock.sleep_until(2.5)
    port.open(1_000_000)
    port.write(protocol2.ping(1))
    assert port.wait(3.0)
    assert port.read() == PING_STATUS


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
    terminal.receive(now)
    terminal.send(now)
    return bytes(client.read(len(STATUS)))


@pytest.mark.parametrize("baud", [57_600, 1_000_000, 4_000_000, 4_500_000])
def test_the_clients_own_speed_decides_which_device_receives_it(tmp_path: Path, baud: int) -> None:
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
    terminal.line.receive = lambda data, now: heard.append(data)  # type: ignore[method-assign]
    with Serial(str(terminal.link.path), 1_000_000, timeout=0.5) as client:
        client.write(every)
        terminal.receive(0.0)
        os.write(terminal.fd, every)
        assert client.read(256) == every
    assert b"".join(heard) == every


def test_a_client_may_come_again_even_after_it_locked_the_port(terminal: PseudoTerminal) -> None:
    for _ in range(2):
        fd = os.open(terminal.link.path, os.O_RDWR | os.O_NOCTTY)
        try:
            fcntl.ioctl(fd, termios.TIOCEXCL)
            os.write(fd, b"x")
            terminal.receive(0.0)
            assert not _locked(fd)
        finally:
            os.close(fd)


def _locked(fd: int) -> bool:
    exclusive = array.array("i", [0])
    fcntl.ioctl(fd, 0x80045440, exclusive)  # TIOCGEXCL
    return bool(exclusive[0])


def test_a_client_that_never_reads_costs_no_memory(terminal: PseudoTerminal) -> None:
    terminal.line.baud = 1_000_000
    with Serial(str(terminal.link.path), 1_000_000):
        for _ in range(6000):
            terminal.line.receive(protocol2.ping(1), 0.0)
            terminal.send(0.0)
    assert terminal.lost > 0


def _asked_twice(folder: Path, *, late: float, answered: float = 0.01) -> tuple[bytes, float]:
    """What a client gets that asks twice in 5 ms, of an emulator that is `late` s late and sends at `answered`, s; and
    by how much the emulator says that it was too late."""
    devices = [StubDevice(baud=1_000_000)]
    terminal = PseudoTerminal(Line(devices, timing=Timing()), Link(folder / "servos"))
    terminal.open()
    with Serial(str(terminal.link.path), 1_000_000, timeout=0.05) as client:
        asked = 2 * protocol2.ping(1)
        client.write(asked)
        held = array.array("i", [0])
        while held[0] < len(asked):
            select.select([terminal.fd], [], [], 1.0)
            fcntl.ioctl(terminal.fd, termios.FIONREAD, held)
        terminal.receive(0.005, late=late)
        terminal.send(answered)
        got = bytes(client.read(2 * len(STATUS)))
    terminal.close()
    return got, terminal.too_late


def test_a_client_that_does_not_wait_collides_with_the_servos(tmp_path: Path) -> None:
    got, too_late = _asked_twice(tmp_path, late=0.0)
    assert len(got) == len(STATUS) and got != STATUS and too_late == 0.0


def test_an_emulator_that_is_late_damages_no_answer(tmp_path: Path) -> None:
    """The client had waited for the first answer; both requests waited for the emulator."""
    assert _asked_twice(tmp_path, late=0.005) == (2 * STATUS, 0.005)


def test_an_answer_that_is_sent_late_is_noted(tmp_path: Path) -> None:
    _, too_late = _asked_twice(tmp_path, late=0.0, answered=1.0)
    assert too_late == pytest.approx(1.0 - 0.00626, abs=1e-4)


def test_a_machine_that_is_too_slow_is_named_and_seldom(tmp_path: Path) -> None:
    clock, turns = VirtualClock(0.0), iter(range(4))
    said: list[str] = []
    devices = [StubDevice(baud=1_000_000)]
    terminal = PseudoTerminal(Line(devices, baud=1_000_000), Link(tmp_path / "servos"))
    terminal.open()

    def late_again() -> bool:
        terminal.line.receive(protocol2.ping(1), clock.now())
        clock.advance(0.3)
        return next(turns, None) is None

    serve([terminal], clock, until=late_again, warn=said.append)
    terminal.close()
    assert said == ["this machine is too slow: the emulator was late by 299 ms"]


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


BAUD = 1_000_000


@contextmanager
def _serving(*terminals: PseudoTerminal) -> Iterator[list[float]]:
    """Serve in a thread; the list gets the CPU time, s, that it took."""
    wake, poke = os.pipe()
    stop = threading.Event()
    cost: list[float] = []

    def work() -> None:
        begun = thread_cpu()
        serve(terminals, MonotonicClock(), until=stop.is_set, listen={wake: lambda: bool(os.read(wake, 1))})
        cost.append(thread_cpu() - begun)

    for terminal in terminals:
        terminal.open()
    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield cost
    finally:
        stop.set()
        os.write(poke, b"x")
        thread.join(5.0)
        for terminal in terminals:
            terminal.close()
        os.close(wake)
        os.close(poke)
        assert not thread.is_alive()


def _serve_terminal(
    path: Path, timing: Timing, faults: Callable[[float], tuple[Fault, ...]] | None = None
) -> PseudoTerminal:
    devices = [StubDevice(id=index, baud=BAUD) for index in range(1, 4)]
    now = MonotonicClock().now()
    state = FaultState(devices, faults=faults(now) if faults else (), origin=now)
    return PseudoTerminal(Line(devices, timing=timing, faults=state), Link(path))


def test_two_lines_answer_each_on_its_own(tmp_path: Path) -> None:
    first, second = (_serve_terminal(tmp_path / name, Timing.none()) for name in ("a", "b"))
    with (
        _serving(first, second),
        Serial(str(tmp_path / "a"), BAUD, timeout=2.0) as one,
        Serial(str(tmp_path / "b"), BAUD, timeout=2.0) as two,
    ):
        two.write(protocol2.ping(1))
        assert two.read(len(STATUS)) == STATUS
        one.write(protocol2.sync_read(0, 1, [1, 2, 3]))
        assert one.read(36) == b"".join(protocol2.status(index, 0, b"\0") for index in (1, 2, 3))


def test_answers_take_their_wire_time(tmp_path: Path) -> None:
    clock = MonotonicClock()
    timing = Timing(latency=20e-3)
    with _serving(_serve_terminal(tmp_path / "a", timing)), Serial(str(tmp_path / "a"), BAUD, timeout=2.0) as client:
        begun = clock.now()
        client.write(protocol2.ping(1))
        assert client.read(len(STATUS)) == STATUS
        took = clock.now() - begun
    assert 0.0195 <= took < 0.2


def test_it_sleeps_when_nothing_is_due(tmp_path: Path) -> None:
    with _serving(_serve_terminal(tmp_path / "a", Timing())) as cost:
        clock = MonotonicClock()
        clock.sleep_until(clock.now() + 0.3)
    assert cost[0] < 0.03


def test_a_plug_is_pulled_and_put_back_by_the_clock(tmp_path: Path) -> None:
    clock = MonotonicClock()
    pulled = _serve_terminal(
        tmp_path / "a", Timing.none(), lambda now: (Fault(FaultKind.UNPLUG, start=0.05, end=0.15),)
    )
    with _serving(pulled):
        end = clock.now() + 5.0
        seen = [True]
        while len(seen) < 3 and clock.now() < end:
            there = os.path.lexists(tmp_path / "a")
            if there != seen[-1]:
                seen.append(there)
            clock.sleep_until(clock.now() + 0.005)
        assert seen == [True, False, True]
        with Serial(str(tmp_path / "a"), BAUD, timeout=2.0) as client:
            client.write(protocol2.ping(1))
            assert client.read(len(STATUS)) == STATUS


def test_a_deadline_ends_it(tmp_path: Path) -> None:
    clock = MonotonicClock()
    begun = clock.now()
    serve([], clock, until=lambda: False, deadline=begun + 0.02)
    assert 0.02 <= clock.now() - begun < 1.0
