"""The loop that serves pseudo-terminals: wire time in real time, several lines, asleep when idle, stopped by a byte."""

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from serial import Serial

from hardware.clock import MonotonicClock, thread_cpu
from hardware.dynamixel import protocol2
from sim.emulator.fault_state import FaultState
from sim.emulator.faults import Fault, FaultKind
from sim.emulator.line import Line
from sim.emulator.link import Link
from sim.emulator.pseudo_terminal import PseudoTerminal
from sim.emulator.serve import serve
from sim.emulator.wire import Timing
from stub_devices import StubDevice

STATUS = protocol2.status(1, 0, b"\x06\x04\x26")
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


def _terminal(path: Path, timing: Timing, faults: Callable[[float], tuple[Fault, ...]] | None = None) -> PseudoTerminal:
    devices = [StubDevice(id=index, baud=BAUD) for index in range(1, 4)]
    now = MonotonicClock().now()
    state = FaultState(devices, faults=faults(now) if faults else (), origin=now)
    return PseudoTerminal(Line(devices, timing=timing, faults=state), Link(path))


def test_two_lines_answer_each_on_its_own(tmp_path: Path) -> None:
    first, second = (_terminal(tmp_path / name, Timing.none()) for name in ("a", "b"))
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
    with _serving(_terminal(tmp_path / "a", timing)), Serial(str(tmp_path / "a"), BAUD, timeout=2.0) as client:
        begun = clock.now()
        client.write(protocol2.ping(1))
        assert client.read(len(STATUS)) == STATUS
        took = clock.now() - begun
    assert 0.0195 <= took < 0.2


def test_it_sleeps_when_nothing_is_due(tmp_path: Path) -> None:
    with _serving(_terminal(tmp_path / "a", Timing())) as cost:
        clock = MonotonicClock()
        clock.sleep_until(clock.now() + 0.3)
    assert cost[0] < 0.03


def test_a_plug_is_pulled_and_put_back_by_the_clock(tmp_path: Path) -> None:
    clock = MonotonicClock()
    pulled = _terminal(tmp_path / "a", Timing.none(), lambda now: (Fault(FaultKind.UNPLUG, start=0.05, end=0.15),))
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
