"""`python -m benchmarks.bus`: cycles with emulated servos in a process of their own, beside dynamixel-sdk in one run.

`--json FILE` keeps the numbers. Linux.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from benchmarks.bus_cycles import Cycles, Missing, by_turns, missing
from benchmarks.bus_emulator import EmulatorProcess
from benchmarks.bus_sides import OurBus, SdkGroups, our_port
from benchmarks.bus_wire import wire_times
from benchmarks.table import options_of, print_table, show_table, write_json

COUNT, BAUD = 20, 4_000_000


def main() -> None:
    """The command."""
    options = options_of(
        "benchmarks.bus",
        __doc__,
        cycles=(1000, "cycles of each side"),
        repeats=(3, "runs of which times are medians"),
    )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        compared = compare(folder, options.cycles, options.repeats)
        gone = miss(folder, max(options.cycles // 4, 50))
        times = wire_times(folder, cycles=max(options.cycles // 5, 40))
    show_table(
        "bus",
        ["driver", "p50, ms", "p99, ms", "thread CPU, ms", "no answer"],
        [[row.side, f"{row.p50:.3f}", f"{row.p99:.3f}", f"{row.cpu:.3f}", str(row.lost)] for row in compared],
        docs=options.docs,
    )
    print_table(
        ["one of 20 missing, ms", "before", "slowest of the first 5", "later, median", "later, slowest", "others"],
        [
            [
                name,
                *(f"{ms:.2f}" for ms in (row.before, row.first, row.later, row.later_slowest)),
                str(row.others),
            ]
            for name, row in zip(("no wire delay", "wire of 4 Mbps"), gone, strict=True)
        ],
    )
    print_table(
        ["cycle with wire timing, ms", "expected", "virtual time", "real time"],
        [
            [
                f"{row.count} servos, {row.baud // 1_000_000} Mbps, {'sync read' if row.plain else 'fast sync read'}",
                *(f"{ms:.2f}" for ms in (row.expected, row.virtual, row.real)),
            ]
            for row in times
        ],
    )
    write_json(options.json, {"cycles": compared, "missing": gone, "wire": times})


def compare(folder: Path, cycles: int, repeats: int) -> list[Cycles]:
    """Ours and the SDK's groups by turns on one pseudo-terminal, without wire delay; medians over the runs."""
    runs = []
    for _ in range(repeats):
        with EmulatorProcess(folder, COUNT, BAUD, wire=False) as emulator:
            sdk = [SdkGroups(emulator.path, COUNT, BAUD, plain=plain) for plain in (False, True)]
            sides = [OurBus(emulator.path, COUNT, BAUD), *sdk]
            runs.append(by_turns(sides, COUNT, cycles))
            for side in sides:
                side.close()
    return [_median(same) for same in zip(*runs, strict=True)]


def _median(same: tuple[Cycles, ...]) -> Cycles:
    p50, p99, cpu = (float(np.median([getattr(one, field) for one in same])) for field in ("p50", "p99", "cpu"))
    return Cycles(same[0].side, p50, p99, cpu, sum(one.lost for one in same))


def miss(folder: Path, cycles: int) -> list[Missing]:
    """One servo of the middle is silent, without wire delay and with it."""
    rows = []
    for wire in (False, True):
        with EmulatorProcess(folder, COUNT, BAUD, wire=wire) as emulator:
            side = our_port(emulator.path, COUNT, BAUD)
            rows.append(missing(side, emulator, count=COUNT, device=COUNT // 2, cycles=cycles))
            side.close()
    return rows


if __name__ == "__main__":
    main()
