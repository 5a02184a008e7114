"""`python -m benchmarks.tick_cost`: what a live tick computes, sensor datagram in to goal bytes out.

OP3 with its observers on emulated servos, all bytes of its bus, on virtual time; five sensors as JSON. Thread CPU of
every tick of following, less what the emulator, its tap and the sender take. What is asked (receive, align,
reconstruct, retarget, gate, encode) is this tick without reading the servos.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.bodies import Floats
from benchmarks.table import add_docs, show_table
from hardware.clock import thread_cpu
from hardware.guard import Guard
from retarget.frames import SensorFrames
from retarget.human.reconstruction import Reconstructor
from retarget.live.performer import LivePerformer
from retarget.robot.follower import Follower
from retarget.run.loop import Loop
from retarget.safety.gate import Gate
from sim.faults.bench import Bench, TappedPort
from sim.faults.sender import FakeSender
from sim.performer import synthetic_performer

FIVE = ("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")
NOT_OURS = [
    *((TappedPort, name) for name in ("read", "write", "wait", "drop", "sleep_until")),
    (FakeSender, "poll"),
    *((Bench, name) for name in ("poll", "see")),
]
READING = "read the bus"
ASKED = "without reading the servos"
FOLLOWING = "follow"
PARTS_OF_ALL = {FOLLOWING: (Follower, "step"), READING: (Guard, "read")}
"""What is measured beside the tick itself where nothing else is."""
PARTS = {
    "receive": (LivePerformer, "poll"),
    "reconstruct": (Reconstructor, "step"),
    **PARTS_OF_ALL,
    "gate": (Gate, "check"),
}
SETTLED = 50
"""Ticks of following that are left out: buffers that are made once."""


class Meter:
    """Thread CPU, s, of what it is put around, without what is not ours. `ticks`: of every tick, by part."""

    def __init__(self) -> None:
        self.ticks: list[dict[str, float]] = []
        self._others = 0.0
        self._now: dict[str, float] = {}

    def other(self, call: Callable[..., Any]) -> Callable[..., Any]:
        """Its time is not ours."""

        def measured(*given: Any, **named: Any) -> Any:
            begun = thread_cpu()
            try:
                return call(*given, **named)
            finally:
                self._others += thread_cpu() - begun

        return measured

    def part(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """Its time is that of a part of the tick."""

        def measured(*given: Any, **named: Any) -> Any:
            begun, others = thread_cpu(), self._others
            try:
                return call(*given, **named)
            finally:
                spent = thread_cpu() - begun - (self._others - others)
                self._now[name] = self._now.get(name, 0.0) + spent

        return measured

    def tick(self, call: Callable[..., Any]) -> Callable[..., Any]:
        """A tick."""
        whole = self.part("tick", call)

        def measured(*given: Any, **named: Any) -> Any:
            self._now = {}
            try:
                return whole(*given, **named)
            finally:
                self.ticks.append(self._now)

        return measured


def five(frames: SensorFrames | None = None) -> SensorFrames:
    """A performer, of whom five sensors are known; None: the synthetic one."""
    frames = synthetic_performer() if frames is None else frames
    rows = [frames.index(name) for name in FIVE]
    return replace(
        frames,
        names=FIVE,
        position=frames.position[:, rows],
        orientation=frames.orientation[:, rows],
        valid=frames.valid[:, rows],
    )


def measure(seconds: float, *, parts: bool) -> dict[str, Floats]:
    """ms of every tick of following, whole, by part, and ASKED. Raises RuntimeError for a run that fails."""
    meter, wanted = Meter(), PARTS if parts else PARTS_OF_ALL
    with ExitStack() as stack:
        for kind, name in NOT_OURS:
            stack.enter_context(patch.object(kind, name, meter.other(getattr(kind, name))))
        for label, (owner, name) in wanted.items():
            stack.enter_context(patch.object(owner, name, meter.part(label, getattr(owner, name))))
        stack.enter_context(patch.object(Loop, "tick", meter.tick(Loop.tick)))
        trace = Bench(FakeSender(five()), duration=seconds).run()
    if trace.error:
        raise RuntimeError(trace.error)
    ticks = [tick for tick in meter.ticks if FOLLOWING in tick][SETTLED:]
    spent = {name: np.array([1e3 * tick.get(name, 0.0) for tick in ticks]) for name in ("tick", *wanted)}
    return spent | {ASKED: spent["tick"] - spent[READING]}


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0, help="of following")
    add_docs(parser)
    wanted = parser.parse_args()
    whole = measure(wanted.seconds, parts=False)
    spent = measure(wanted.seconds, parts=True)
    shown = {"whole tick": whole["tick"], ASKED: whole[ASKED], **{name: spent[name] for name in PARTS}}
    rows = [[name, f"{np.median(ms):.2f}", f"{np.percentile(ms, 99):.2f}"] for name, ms in shown.items()]
    show_table("tick", ["thread CPU, ms", "median", "p99"], rows, docs=wanted.docs)
    print(f"{len(whole['tick'])} ticks; asked of a tick without reading the servos: 1.0, 2.0")


if __name__ == "__main__":
    main()
