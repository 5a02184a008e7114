"""`python -m benchmarks.bus`: cycles with emulated servos in a process of their own, beside dynamixel-sdk in one run.

`--json FILE` keeps the numbers. Linux.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from benchmarks.bus_cycles import Cycles, by_turns
from benchmarks.bus_emulator import EmulatorProcess
from benchmarks.bus_sides import OurBus, SdkGroups
from benchmarks.table import options_of, show_table, write_json

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
        with EmulatorProcess(folder, COUNT, BAUD) as emulator:
            sdk = [SdkGroups(emulator.path, COUNT, BAUD, plain=plain) for plain in (False, True)]
            sides = [OurBus(emulator.path, COUNT, BAUD), *sdk]
            runs.append(by_turns(sides, COUNT, cycles))
            for side in sides:
                side.close()
    return [_median(same) for same in zip(*runs, strict=True)]


def _median(same: tuple[Cycles, ...]) -> Cycles:
    p50, p99, cpu = (float(np.median([getattr(one, field) for one in same])) for field in ("p50", "p99", "cpu"))
    return Cycles(same[0].side, p50, p99, cpu, sum(one.lost for one in same))


if __name__ == "__main__":
    main()
