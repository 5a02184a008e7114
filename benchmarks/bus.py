"""`python -m benchmarks.bus`: cycles with emulated servos in a process of their own, beside dynamixel-sdk in one run.

`--json FILE` keeps the numbers. Linux. Cycles on a virtual wire stand beside those that bytes, baud rate, turnaround
and the adapter's latency make.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.bodies import Floats
from benchmarks.bus_sides import CENTRE, GOAL_SIZE, PRESENT_SIZE, BusSide, OurBus, OurPort, SdkGroups, make_line
from benchmarks.table import options_of, show_table, write_json
from hardware.arrays import TickArray
from hardware.clock import MonotonicClock, VirtualClock, thread_cpu
from hardware.dynamixel.cyclic import STATUS_EVERY
from sim.emulator.line import LineTiming
from sim.emulator.ports import EmulatedPort

ROBOT, COUNT, BAUD = "op3", 20, 2_000_000
"""The emulated servos: so many XM430-W350."""


def main() -> None:
    """The command."""
    options = options_of(
        "benchmarks.bus",
        __doc__,
        cycles=(1000, "cycles of each side"),
        repeats=(3, "runs of which times are medians"),
    )
    with tempfile.TemporaryDirectory() as name:
        compared = compare(Path(name), options.cycles, options.repeats)
    show_table(
        "bus",
        ["driver", "p50, ms", "p99, ms", "thread CPU, ms", "no answer"],
        [[row.side, f"{row.p50:.3f}", f"{row.p99:.3f}", f"{row.cpu:.3f}", str(row.lost)] for row in compared],
        docs=options.docs,
    )
    write_json(options.json, {"cycles": compared})


def compare(folder: Path, cycles: int, repeats: int) -> list[Cycles]:
    """Ours and the SDK's groups by turns on one pseudo-terminal, without wire delay; medians over the runs."""
    runs = []
    for _ in range(repeats):
        with emulated_servos(folder) as path:
            sdk = [SdkGroups(path, COUNT, BAUD, plain=plain) for plain in (False, True)]
            sides: list[BusSide] = [OurBus(path, COUNT, BAUD), *sdk]
            runs.append(by_turns(sides, COUNT, cycles))
            for side in sides:
                side.close()
    return [_median(same) for same in zip(*runs, strict=True)]


def _median(same: tuple[Cycles, ...]) -> Cycles:
    p50, p99, cpu = (float(np.median([getattr(one, field) for one in same])) for field in ("p50", "p99", "cpu"))
    return Cycles(same[0].side, p50, p99, cpu, sum(one.lost for one in same))


@contextmanager
def emulated_servos(folder: Path) -> Iterator[str]:
    """The port of `retarget emulate` in a process of its own, without wire delay."""
    path = str(folder / "servos")
    words = [sys.executable, "-m", "retarget", "emulate", "--robot", ROBOT, "--link", path, "--no-wire-delay"]
    with subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()  # it answers
        try:
            yield path
        finally:
            process.send_signal(signal.SIGINT)


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


def _percentiles(seconds: Floats) -> tuple[float, float]:
    p50, p99 = np.percentile(seconds, [50.0, 99.0]) * 1e3
    return float(p50), float(p99)


# On a virtual wire.

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
    port = EmulatedPort(make_line(count, baud, LineTiming(latency=ADAPTER, turnaround=TURNAROUND), 0.0), clock)
    port.open(baud)
    side = OurPort(port, count, plain=plain)
    clock.advance(0.1)
    spent = []
    for k in range(cycles):
        begun = clock.now()
        side.cycle(goals(count, k))
        spent.append(clock.now() - begun)
    return 1e3 * float(np.median(spent))


if __name__ == "__main__":
    main()
