"""Cycles of several sides by turns, with their time and what they cost."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.bodies import Floats
from benchmarks.bus_emulator import CENTRE
from benchmarks.bus_sides import BusSide
from hardware.arrays import TickArray
from hardware.clock import MonotonicClock, thread_cpu

WARM_UP = 50
"""Cycles at first that do not count."""


@dataclass(frozen=True)
class Cycles:
    """Times of one side's cycles in ms: wall, and CPU of its thread; lost: servos without values, of all cycles."""

    side: str
    p50: float
    p99: float
    cpu: float
    lost: int


def by_turns(sides: Sequence[BusSide], count: int, cycles: int) -> list[Cycles]:
    """Each side does a cycle, then the next: whatever else the machine does meets all of them."""
    clock = MonotonicClock()
    wall, cpu = np.zeros((cycles, len(sides))), np.zeros((cycles, len(sides)))
    lost = [0] * len(sides)
    for k in range(-WARM_UP, cycles):
        ticks = goals(count, k)
        for s, side in enumerate(sides):
            begun, before = clock.now(), thread_cpu()
            answered = side.cycle(ticks)
            if k >= 0:
                cpu[k, s], wall[k, s] = thread_cpu() - before, clock.now() - begun
                lost[s] += count - answered
    return [
        Cycles(side.name, *_percentiles(wall[:, s]), float(np.median(cpu[:, s])) * 1e3, lost[s])
        for s, side in enumerate(sides)
    ]


def goals(count: int, k: int) -> TickArray:
    """A slow wave, ticks (count,)."""
    ticks: TickArray = CENTRE + np.rint(300.0 * np.sin(0.01 * k + 0.3 * np.arange(count))).astype(np.int64)
    return ticks


def median_cycle(cycle: Callable[[TickArray], int], now: Callable[[], float], *, count: int, cycles: int) -> float:
    """Median time of a cycle in ms, on a given clock."""
    spent = []
    for k in range(cycles):
        begun = now()
        cycle(goals(count, k))
        spent.append((now() - begun) * 1e3)
    return float(np.median(spent))


def _percentiles(seconds: Floats) -> tuple[float, float]:
    p50, p99 = np.percentile(seconds, [50.0, 99.0]) * 1e3
    return float(p50), float(p99)
