"""Wire time: the tables of cycle times that follow from baud rate, bytes, return delay, turnaround and latency."""

from dataclasses import replace

import pytest

from hardware.clock import VirtualClock
from hardware.dynamixel import protocol2
from sim.emulator.line import Line
from sim.emulator.loopback import EmulatedPort
from sim.emulator.wire import Timing
from stub_devices import StubDevice

BAUDS = (1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
# Cycle in ms: sync write of 4 bytes, then a read of `length` bytes, by plain or fast sync read, at BAUDS.
TABLE = [
    (20, 10, False, 0.0, (7.08, 4.24, 3.29, 2.82, 2.66)),
    (20, 10, True, 0.0, (5.38, 3.20, 2.47, 2.11, 1.99)),
    (20, 10, False, 500e-6, (17.1, 14.2, 13.3, 12.8, 12.7)),
    (30, 10, False, 0.0, (9.98, 5.79, 4.39, 3.70, 3.46)),
    (30, 10, True, 0.0, (7.38, 4.20, 3.14, 2.61, 2.43)),
    (30, 10, False, 500e-6, (25.0, 20.8, 19.4, 18.7, 18.5)),
    (20, 4, False, 0.0, (5.88, 3.64, 2.89, 2.52, 2.40)),
    (20, 4, True, 0.0, (4.18, 2.60, 2.07, 1.81, 1.72)),
    (10, 10, False, 0.0, (4.18, 2.69, 2.19, 1.95)),
    (10, 10, True, 0.0, (3.38, 2.20, 1.81, 1.61)),
]
WIRE_ONLY = [
    (20, 10, False, 0.0, (5.68, 2.84, 1.89, 1.42, 1.26)),
    (20, 10, True, 0.0, (4.36, 2.18, 1.45, 1.09, 0.97)),
    (30, 10, True, 0.0, (6.36, 3.18, 2.12, 1.59, 1.41)),
]
ROWS = [(Timing(), *row) for row in TABLE]
ROWS += [(Timing(turnaround=0.0, latency=0.0), *row) for row in WIRE_ONLY]
ROWS += [(Timing(latency=16e-3), 20, 10, False, 0.0, (22.1, 19.2, 18.3, 17.8, 17.7))]
EACH = [(*row[:-1], baud, ms) for row in ROWS for baud, ms in zip(BAUDS, row[-1], strict=False)]


def _cycle(timing: Timing, count: int, length: int, fast: bool, return_delay: float, baud: int) -> float:
    """Time in s from the first byte out to the last byte in."""
    clock = VirtualClock(3.0)
    devices = [StubDevice(id=index, baud=baud, return_delay=return_delay) for index in range(1, count + 1)]
    port = EmulatedPort(Line(devices, timing=timing), clock)
    port.open(baud)
    ids = range(1, count + 1)
    port.write(protocol2.sync_write(116, 4, [(index, bytes(4)) for index in ids]))
    port.write(protocol2.sync_read(126, length, ids, fast=fast))
    wanted = 8 + count * (length + 4) if fast else count * (11 + length)
    got = 0
    while got < wanted:
        assert port.wait(4.0)
        got += len(port.read())
    assert got == wanted
    return clock.now() - 3.0


@pytest.mark.parametrize(("timing", "count", "length", "fast", "delay", "baud", "ms"), EACH)
def test_cycle_times_are_those_of_the_table(
    timing: Timing, count: int, length: int, fast: bool, delay: float, baud: int, ms: float
) -> None:
    assert _cycle(timing, count, length, fast, delay, baud) * 1e3 == pytest.approx(ms, rel=0.01)


def test_without_delays_nothing_takes_time() -> None:
    assert _cycle(Timing.none(), 20, 10, False, 500e-6, 57600) == 0.0


def test_a_share_of_the_return_delay() -> None:
    assert replace(Timing(), return_delay=0.5).before_status(1e-3) == pytest.approx(0.5e-3 + 20e-6)
