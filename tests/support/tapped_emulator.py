"""`retarget emulate`, and a log of what its client sends and of bus watchdogs that stop a servo: first word FILE.

A line each, times on the machine's monotonic clock, s: `heard TIME HEX` and `tripped TIME`, of the emulator.
"""

import sys
from pathlib import Path

from retarget import cli
from sim.emulator.line import Line
from sim.emulator.servo2_registers import BusWatchdog


def main(log: str, *words: str) -> None:
    """Emulate until a signal ends it."""
    receive, trip = Line.receive, BusWatchdog.trip
    with Path(log).open("w", buffering=1, encoding="ascii") as out:

        def received(self: Line, data: bytes, now: float) -> None:
            out.write(f"heard {now!r} {data.hex()}\n")
            receive(self, data, now)

        def tripped(self: BusWatchdog) -> None:
            out.write(f"tripped {self.deadline!r}\n")
            trip(self)

        Line.receive, BusWatchdog.trip = received, tripped  # type: ignore[method-assign]
        cli.main(["emulate", *words])


if __name__ == "__main__":
    main(*sys.argv[1:])
