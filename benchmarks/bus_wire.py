"""Cycle times with the wire's, beside those that bytes, baud rate, turnaround and the adapter's latency make."""

from __future__ import annotations

import numpy as np

from benchmarks.bus_cycles import median_cycle
from benchmarks.bus_emulator import make_line
from benchmarks.bus_sides import GOAL_SIZE, PRESENT_SIZE, OurPort
from hardware.clock import VirtualClock
from hardware.dynamixel.cyclic import STATUS_EVERY
from sim.emulator.line import Timing
from sim.emulator.ports import EmulatedPort

BAUDS = (1_000_000, 2_000_000, 3_000_000, 4_000_000)
ADAPTER, TURNAROUND = 1e-3, 20e-6
"""[s] Latency timer, and what each answer takes beside its bytes: of the table of expected times."""


def expected_ms(count: int, baud: int, *, plain: bool) -> float:
    """Sync write of goals, then a group read of current, velocity and position, without return delay."""
    sent = 14 + count * (1 + GOAL_SIZE) + 14 + count
    coming = count * (11 + PRESENT_SIZE) if plain else 8 + count * (PRESENT_SIZE + 4)
    return 1e3 * (10.0 * (sent + coming) / baud + (count if plain else 1) * TURNAROUND + ADAPTER)


def virtual_ms(count: int, baud: int, *, plain: bool, cycles: int = 10 * STATUS_EVERY) -> float:
    """Median time of a cycle in ms on a virtual clock."""
    clock = VirtualClock()
    port = EmulatedPort(make_line(count, baud, Timing(latency=ADAPTER, turnaround=TURNAROUND), 0.0), clock)
    port.open(baud)
    side = OurPort(port, count, plain=plain)
    clock.advance(0.1)
    spent = median_cycle(side.cycle, clock.now, count=count, cycles=cycles)
    assert np.isfinite(spent)
    return spent
