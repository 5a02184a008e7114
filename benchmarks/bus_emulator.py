"""Emulated XM430-W350 on a pseudo-terminal, in a process of their own.

`python -m benchmarks.bus_emulator LINK COUNT BAUD`: until the end of its input.
"""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import TracebackType

import numpy as np

from hardware.bus import BusSpec
from hardware.clock import MonotonicClock
from hardware.servo import ServoSpec, find_model
from sim.emulator.line import REAL_TIME_GAP, Line, Timing
from sim.emulator.ports import Link, PseudoTerminal, serve
from sim.emulator.robot_lines import robot_lines

CENTRE = 2048
"""Tick at which every servo begins."""
READY = "ready\n"


def servo_specs(count: int) -> list[ServoSpec]:
    """`count` servos with ids from 1 on, on one bus."""
    model = find_model("XM430-W350")
    return [
        ServoSpec(f"joint{device}", device, model, "bench", 1, CENTRE, -3.0, 3.0, 4.0, 40.0)
        for device in range(1, count + 1)
    ]


def bus_spec(count: int, baud: int, port: str = "") -> BusSpec:
    """Their bus, without return delay."""
    return BusSpec("bench", port, baud, 2, tuple(range(1, count + 1)))


def make_line(count: int, baud: int, timing: Timing, now: float) -> Line:
    """Their line."""
    lines = robot_lines(
        servo_specs(count), [bus_spec(count, baud)], start=np.full(count, CENTRE), now=now, timing=timing, powered=True
    )
    return lines["bench"]


class EmulatorProcess:
    """The process; `path` is its port."""

    def __init__(self, folder: Path, count: int, baud: int) -> None:
        self.path = str(folder / f"servos-{count}-{baud}")
        words = [sys.executable, "-m", "benchmarks.bus_emulator", self.path, str(count), str(baud)]
        self._process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self._process.stdin and self._process.stdout
        self._input, self._output = self._process.stdin, self._process.stdout
        if self._output.readline() != READY:
            raise RuntimeError("the emulator's process did not start")

    def __enter__(self) -> EmulatorProcess:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._input.close()
        self._process.wait()
        self._output.close()


def main() -> None:
    """The process itself."""
    path, count, baud = sys.argv[1:]
    clock = MonotonicClock()
    timing = replace(Timing.none(), gap=REAL_TIME_GAP)
    line = make_line(int(count), int(baud), timing, clock.now())
    terminal = PseudoTerminal(line, Link(Path(path)))
    terminal.open()
    ended: list[bool] = []

    def at_end() -> bool:
        if not os.read(0, 4096):
            ended.append(True)
        return not ended

    try:
        print(READY, end="", flush=True)
        serve([terminal], clock, until=lambda: bool(ended), listen={0: at_end})
    finally:
        terminal.close()


if __name__ == "__main__":
    main()
