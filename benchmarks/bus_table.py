"""Tables of the benchmark of the bus, as Markdown."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.bus_cycles import Cycles, Load, Missing
from benchmarks.bus_wire import WireTime

FULL_RATES = ("1 Mbps", "2 Mbps", "4 Mbps")


def print_cycles(rows: Sequence[Cycles], count: int) -> None:
    """Ours first in each group of rows that took turns."""
    print(f"\n| {count} servos, no wire delay | p50, ms | p99, ms | thread CPU, ms | ours / side | no answer |")
    print("|---|---:|---:|---:|---:|---:|")
    ours = rows[0].cpu
    for row in rows:
        mine = not row.side.startswith("dynamixel-sdk")
        ours = row.cpu if mine else ours
        share = "" if mine else f"{ours / row.cpu:.2f}"
        print(f"| {row.side} | {row.p50:.3f} | {row.p99:.3f} | {row.cpu:.3f} | {share} | {row.lost} |")


def print_missing(rows: Sequence[Missing]) -> None:
    """Without wire delay, then with it."""
    print("\n| one of 20 missing, ms | before | slowest of the first 5 | later, median | later, slowest | others |")
    print("|---|---:|---:|---:|---:|---:|")
    for name, row in zip(("no wire delay", "wire of 4 Mbps"), rows, strict=True):
        print(
            f"| {name} | {row.before:.2f} | {row.first:.2f} | {row.later:.2f} | {row.later_slowest:.2f} | "
            f"{row.others} |"
        )


def print_loads(rows: Sequence[Load], rate: float, full: int) -> None:
    """The host paced, the emulator at full rate, the emulator at a robot's usual rate."""
    names = [f"20 servos, {rate:.0f} Hz, no wire delay"]
    names += [f"{full} servos, {name}, cycle after cycle" for name in FULL_RATES]
    names += [f"{full} servos, 2 Mbps, 125 Hz"]
    print("\n| % of a core | cycles per s | host's thread | emulator's process | no answer |")
    print("|---|---:|---:|---:|---:|")
    for name, row in zip(names, rows, strict=True):
        print(f"| {name} | {row.rate:.0f} | {100 * row.host:.1f} | {100 * row.emulator:.1f} | {row.lost} |")


def print_wire(rows: Sequence[WireTime]) -> None:
    """Each time with its deviation from the expected one."""
    print("\n| cycle with wire timing, ms | expected | virtual time | | real time | |")
    print("|---|---:|---:|---:|---:|---:|")
    for row in rows:
        kind = "sync read" if row.plain else "fast sync read"
        cells = " | ".join(
            f"{value:.2f} | {100 * (value / row.expected - 1):+.0f} %" for value in (row.virtual, row.real)
        )
        print(f"| {row.count} servos, {row.baud // 1_000_000} Mbps, {kind} | {row.expected:.2f} | {cells} |")
