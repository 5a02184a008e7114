"""Devices served on a pseudo-terminal by a thread, for clients of their own."""

import os
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from hardware.clock import MonotonicClock
from sim.emulator.device import Device
from sim.emulator.fault_state import FaultState
from sim.emulator.line import REAL_TIME_GAP, Line, Timing
from sim.emulator.ports import Link, PseudoTerminal, serve

NO_DELAY = replace(Timing.none(), gap=REAL_TIME_GAP)


@contextmanager
def served(devices: Sequence[Device], path: Path, timing: Timing = NO_DELAY) -> Iterator[Line]:
    """Serve devices on `path` while the context lasts."""
    clock = MonotonicClock()
    line = Line(devices, timing=timing, faults=FaultState(devices, origin=clock.now()))
    terminal = PseudoTerminal(line, Link(path))
    terminal.open()
    wake, poke = os.pipe()
    stop = threading.Event()
    listen = {wake: lambda: bool(os.read(wake, 1))}
    thread = threading.Thread(target=lambda: serve([terminal], clock, until=stop.is_set, listen=listen))
    before = sys.getswitchinterval()
    sys.setswitchinterval(2e-4)  # a client that spins would keep the thread waiting for 5 ms each time
    thread.start()
    try:
        yield line
    finally:
        stop.set()
        os.write(poke, b"x")
        thread.join(5.0)
        sys.setswitchinterval(before)
        terminal.close()
        os.close(wake)
        os.close(poke)
