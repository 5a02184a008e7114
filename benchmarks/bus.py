"""`python -m benchmarks.bus`: cycles with emulated servos in a process of their own, beside dynamixel-sdk in one run.

Prints the tables that docs/benchmarks.md draws on; `--json FILE` keeps the numbers. Linux.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.bus_cycles import Cycles, Load, Missing, by_turns, load, missing
from benchmarks.bus_emulator import EmulatorProcess
from benchmarks.bus_sides import OurBus, SdkGroups, our_port
from benchmarks.bus_table import print_cycles, print_loads, print_missing, print_wire
from benchmarks.bus_wire import WireTime, wire_times

COUNT, BAUD = 20, 4_000_000
FULL = 30
RATE = 200.0
"""[Hz] At which the host's share of a core is taken."""


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bus", description=__doc__)
    parser.add_argument("--cycles", type=int, default=1000, help="cycles of each side")
    parser.add_argument("--repeats", type=int, default=3, help="runs of which times are medians")
    parser.add_argument("--seconds", type=float, default=4.0, help="how long shares of a core are taken")
    parser.add_argument("--no-wire", action="store_true", help="leave out the table of baud rates")
    parser.add_argument("--json", type=Path, help="file for the numbers")
    options = parser.parse_args()
    rows: dict[str, list[Cycles] | list[Load] | list[Missing] | list[WireTime]] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rows["cycles"] = compared = compare(folder, options.cycles, options.repeats)
        print_cycles(compared, COUNT)
        rows["missing"] = gone = miss(folder, max(options.cycles // 4, 50))
        print_missing(gone)
        rows["loads"] = shares = loads(folder, options.seconds)
        print_loads(shares, RATE, FULL)
        if not options.no_wire:
            rows["wire"] = times = wire_times(folder, cycles=max(options.cycles // 5, 40))
            print_wire(times)
    if options.json is not None:
        text = json.dumps({key: [dataclasses.asdict(row) for row in part] for key, part in rows.items()}, indent=1)
        options.json.write_text(text + "\n", encoding="utf-8")


def compare(folder: Path, cycles: int, repeats: int) -> list[Cycles]:
    """Ours and the SDK's groups by turns on one pseudo-terminal, without wire delay; medians over the runs."""
    runs = []
    for _ in range(repeats):
        with EmulatorProcess(folder, COUNT, BAUD, wire=False) as emulator:
            path = emulator.path
            sdk = [SdkGroups(path, COUNT, BAUD, plain=plain) for plain in (False, True)]
            bare = SdkGroups(path, COUNT, BAUD, values=False)
            bus = OurBus(path, COUNT, BAUD)
            runs.append(by_turns([bus, *sdk, bare], COUNT, cycles))
            bus.close()
            fast = our_port(path, COUNT, BAUD)
            runs[-1] += by_turns([fast, *sdk, bare], COUNT, cycles)
            fast.close()
            plain = our_port(path, COUNT, BAUD, plain=True)
            runs[-1] += by_turns([plain, *sdk, bare], COUNT, cycles)
            plain.close()
            for side in (*sdk, bare):
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


def loads(folder: Path, seconds: float) -> list[Load]:
    """The host at RATE; then the emulator cycle after cycle."""
    with EmulatorProcess(folder, COUNT, BAUD, wire=False) as emulator:
        bus = OurBus(emulator.path, COUNT, BAUD)
        paced = load(bus, emulator, count=COUNT, seconds=seconds, period=1.0 / RATE)
        bus.close()
    rows = [paced]
    for baud in (1_000_000, 2_000_000, 4_000_000):
        with EmulatorProcess(folder, FULL, baud, wire=True) as emulator:
            side = our_port(emulator.path, FULL, baud)
            rows.append(load(side, emulator, count=FULL, seconds=seconds, period=0.0))
            side.close()
    with EmulatorProcess(folder, FULL, 2_000_000, wire=True) as emulator:
        side = our_port(emulator.path, FULL, 2_000_000)
        rows.append(load(side, emulator, count=FULL, seconds=seconds, period=1.0 / 125.0))
        side.close()
    return rows


if __name__ == "__main__":
    main()
