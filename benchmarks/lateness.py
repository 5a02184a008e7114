"""`python -m benchmarks.lateness`: how late ticks wake up, of the live loop and an empty one by turns.

The live loop receives what `examples/send_poses.py` sends in another process, and moves OP3 on emulated servos with the
bytes of its bus, at 100 Hz. Lateness: when a tick wakes up, minus its deadline, and what a tick before took over its
period.
"""

from __future__ import annotations

import gc
import os
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.bodies import Floats
from benchmarks.table import ROOT, options_of, show_table, write_json
from hardware.bus import ServoBus
from hardware.clock import Clock, MonotonicClock
from hardware.realtime import Scheduling, scheduled
from retarget.human.samples import Performance
from retarget.live.address import parse_address
from retarget.live.begin import LiveOptions, begin_live
from retarget.live.open_stream import open_stream
from retarget.model.robot import RobotBody
from retarget.run.loop import Operator
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare_for
from retarget.run.supervisor import OperatorInput
from retarget.schema.catalogue import Kind, find
from retarget.schema.performer import Performer
from retarget.types import RunState
from sim.buses import emulated_bus

RATE_HZ = 100.0
DT = 1.0 / RATE_HZ
SPARE_S = 15.0
"""So much longer than it is measured a run may last, because the way to the performer takes a while."""


class Stopwatch(MonotonicClock):
    """A clock that keeps how late every sleep ended, s, while `counting`."""

    def __init__(self) -> None:
        self.late: list[float] = []
        self.counting = False
        self._before = float("inf")

    def sleep_until(self, deadline: float) -> None:
        """Sleep, and keep how late it ended. A deadline that was put off counts from where it would have been."""
        super().sleep_until(deadline)
        if self.counting:
            self.late.append(self.now() - min(deadline, self._before + DT))
        self._before = deadline


@dataclass(frozen=True)
class Lateness:
    """ms; missed: ticks that came later than a whole period."""

    loop: str
    ticks: int
    p50: float
    p99: float
    longest: float
    missed: int


def lateness(loop: str, late: Floats) -> Lateness:
    """Of late (T,), s."""
    p50, p99, longest = np.percentile(late, (50.0, 99.0, 100.0)) * 1e3
    return Lateness(loop, len(late), float(p50), float(p99), float(longest), int((late > DT).sum()))


def empty_leg(seconds: float) -> list[float]:
    """Ticks in which nothing is done."""
    clock = Stopwatch()
    clock.counting = True
    deadline = clock.now()
    for _ in range(round(seconds * RATE_HZ)):
        deadline = max(deadline + DT, clock.now())
        clock.sleep_until(deadline)
    return clock.late


def live_leg(seconds: float, robot: Path) -> list[float]:
    """Ticks that follow a live performer."""
    port = free_port()
    address, clock = parse_address(f"json://:{port}"), Stopwatch()

    def perform(performer: Performer, body: RobotBody | None) -> Performance:
        stream = open_stream(address, performer)
        options = LiveOptions(countdown=0.0, patience=20.0, duration=seconds + SPARE_S)
        return begin_live(stream, options, clock=clock, rate_hz=RATE_HZ, where=address.text, notify=lambda text: None)

    def make_bus(body: RobotBody, _: Clock) -> ServoBus:
        stand = body.posture(body.profile.postures.stand)[body.servo_columns]
        return emulated_bus(body, MonotonicClock(), start=body.joint_map.to_ticks(stand))

    options = RunOptions(robot=str(robot), bus="emulator")
    with (
        pose_sender(port),
        prepare_for(perform, options, clock=clock, make_bus=make_bus, goes_to_rest=True) as prepared,
    ):

        class Enough(Operator):
            def poll(self, state: RunState | None) -> OperatorInput:
                clock.counting = state is RunState.FOLLOW
                return OperatorInput(stop="enough" if len(clock.late) >= seconds * RATE_HZ else None)

        result = prepared.run(Enough())
    if len(clock.late) < seconds * RATE_HZ:
        raise SystemExit(f"the live loop did not last ({result.reason}): a quieter machine, or --realtime 40")
    return clock.late[: round(seconds * RATE_HZ)]


@contextmanager
def pose_sender(port: int) -> Iterator[None]:
    """A performer who stands for 6 s and then moves arms, for as long as a leg lasts."""
    words = [sys.executable, str(ROOT / "examples" / "send_poses.py"), "127.0.0.1", str(port), "3600"]
    with subprocess.Popen(words) as process:
        try:
            yield
        finally:
            process.kill()


def free_port() -> int:
    """A free UDP port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def at_rate(folder: Path) -> Path:
    """OP3's profile at RATE_HZ, in `folder`."""
    path = Path(shutil.copytree(find(Kind.ROBOT, "op3").parent, folder / "op3")) / "robot.yaml"
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    changed = [f"  rate_hz: {RATE_HZ:g}\n" if line.startswith("  rate_hz:") else line for line in lines]
    assert changed != lines
    path.write_text("".join(changed), encoding="utf-8")
    return path


def by_turns(seconds: float, turns: int, live: Callable[[float], list[float]]) -> tuple[Lateness, Lateness]:
    """The live loop and the empty one, `turns` times each."""
    ours: list[float] = []
    empty: list[float] = []
    for _ in range(turns):
        ours += live(seconds)
        gc.collect()
        gc.disable()
        empty += empty_leg(seconds)
        gc.enable()
    return lateness("live", np.array(ours)), lateness("empty", np.array(empty))


def main() -> None:
    """The command."""
    options = options_of(
        "benchmarks.lateness",
        __doc__,
        seconds=(20.0, "of each leg"),
        turns=(3, "legs of each loop"),
        realtime=(0, "priority of both"),
        core=(-1, "the only core of both"),
    )
    load = os.getloadavg()[0]
    how = Scheduling(priority=options.realtime or None, core=None if options.core < 0 else options.core)
    with tempfile.TemporaryDirectory() as name, scheduled(how):
        robot = at_rate(Path(name))
        live, empty = by_turns(options.seconds, options.turns, lambda seconds: live_leg(seconds, robot))
    heads = [f"{RATE_HZ:g} Hz, load {load:.1f}", "p50, ms", "p99, ms", "longest, ms", "over a period"]
    rows = [
        [row.loop, *(f"{ms:.3f}" for ms in (row.p50, row.p99, row.longest)), f"{row.missed} of {row.ticks}"]
        for row in (live, empty)
    ]
    show_table("lateness", heads, rows, docs=options.docs)
    write_json(options.json, {"lateness": [live, empty]})


if __name__ == "__main__":
    main()
