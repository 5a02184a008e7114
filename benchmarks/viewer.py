"""`python -m benchmarks.viewer`: what a page that is looked at costs a tick, and what one that hangs does to it.

OP3 on a mock bus follows the synthetic performer in real time, by turns without a page, with one that a client reads,
and with one whose process is stopped (SIGSTOP). Thread CPU of everything between two sleeps of the loop; lateness is
when a tick wakes up, minus its deadline.
"""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from benchmarks.bodies import Floats
from benchmarks.table import options_of, print_table, write_json
from hardware.clock import MonotonicClock, thread_cpu
from retarget.cli.buses import make_bus
from retarget.cli.exit import StopRequest
from retarget.cli.operator import RunOperator
from retarget.cli.view import opened_page, viewing
from retarget.human.samples import Playback
from retarget.run.loop import RunObserver
from retarget.run.options import RunOptions
from retarget.run.prepare import Prepared, prepare
from retarget.run.supervisor import OperatorInput
from retarget.types import RunState
from retarget.web.feed import ViewFeed
from sim.performer import synthetic_performer

LEGS = ("off", "looked at", "stopped")
SETTLED = 125
"""Ticks of following that are left out: buffers that are made once, and a page that opens."""
LEAST_READ = 100_000
"""Bytes of a page that was looked at."""


class TickMeter(MonotonicClock):
    """A clock of a loop that sleeps once a tick: thread CPU, s, between two sleeps, and how late each ended, s."""

    def __init__(self) -> None:
        self.cpu: list[float] = []
        self.late: list[float] = []
        self.counting = False
        self._awake = 0.0

    def sleep_until(self, deadline: float) -> None:
        """Sleep."""
        if self.counting:
            self.cpu.append(thread_cpu() - self._awake)
        super().sleep_until(deadline)
        if self.counting:
            self.late.append(self.now() - deadline)
        self._awake = thread_cpu()


@dataclass(frozen=True)
class Leg:
    """ms; share: of the thread CPU of the ticks without a page, by their medians; missed: ticks that woke up later than
    a whole period."""

    page: str
    ticks: int
    cpu_p50: float
    cpu_mean: float
    cpu_p99: float
    share: float
    late_p50: float
    late_p99: float
    longest: float
    missed: int


def leg(page: str, seconds: float) -> tuple[list[float], list[float]]:
    """Thread CPU and lateness, s, of ticks that follow. Raises SystemExit for a run that does not last."""
    meter, options = TickMeter(), RunOptions(robot="op3", playback=Playback(loop=True))
    with (
        prepare(
            synthetic_performer,
            options,
            clock=meter,
            make_bus=lambda body, clock: make_bus(options.bus, body, clock),
        ) as prepared,
        looked_at(page, prepared, options) as (viewed, feed),
    ):
        stop, ticks, followed = StopRequest(), round(seconds / prepared.samples.dt), 0

        class Enough(RunOperator):
            def poll(self, state: RunState | None) -> OperatorInput:
                nonlocal followed
                followed += state is RunState.FOLLOW
                if followed == SETTLED // 2 and page == "stopped" and feed is not None:
                    os.kill(feed.process, signal.SIGSTOP)
                meter.counting = followed > SETTLED
                if len(meter.late) >= ticks:
                    stop.request("enough")
                return super().poll(state)

        gc.collect()
        result = prepared.run(Enough(prepared, stop, page=feed), [viewed])
        meter.counting = False
    if len(meter.late) < ticks:
        raise SystemExit(f"the run did not last ({result.reason}): a quieter machine")
    return meter.cpu[1:ticks], meter.late[:ticks]


@contextmanager
def looked_at(page: str, prepared: Prepared, options: RunOptions) -> Iterator[tuple[RunObserver, ViewFeed | None]]:
    """A page in one of LEGS, and a client that reads it. Raises SystemExit where nothing was to be read."""
    if page == "off":
        yield RunObserver(), None
        return
    messages: list[str] = []
    with (
        opened_page(0, options, messages.append) as feed,
        viewing(feed, prepared, options, notify=messages.append) as viewed,
    ):
        assert feed is not None
        looker = subprocess.Popen(
            ["nice", "-n", "10", sys.executable, "-m", "benchmarks.looker", feed.address], stdout=subprocess.PIPE
        )
        assert looker.stdout is not None
        looker.stdout.readline()  # it is there
        try:
            yield viewed, feed
        finally:
            if page == "stopped":
                os.kill(feed.process, signal.SIGKILL)
    read = int(looker.communicate(timeout=60.0)[0])
    if page == "looked at" and read < LEAST_READ:
        raise SystemExit(f"no client read the page: {read} bytes were read")


def row(page: str, cpu: Floats, late: Floats, *, without: float, period: float) -> Leg:
    """Of thread CPU and lateness (T,), s. without: median thread CPU without a page, s; period: s of a tick."""
    p50, p99 = np.percentile(cpu, (50.0, 99.0)) * 1e3
    on_time, at_most, longest = np.percentile(late, (50.0, 99.0, 100.0)) * 1e3
    mean, share, missed = float(cpu.mean()) * 1e3, float(p50) / (1e3 * without), int((late > period).sum())
    return Leg(
        page, len(cpu), float(p50), mean, float(p99), share, float(on_time), float(at_most), float(longest), missed
    )


def by_turns(seconds: float, turns: int) -> list[Leg]:
    """Each of LEGS, `turns` times, one after the other."""
    cpu: dict[str, list[float]] = {page: [] for page in LEGS}
    late: dict[str, list[float]] = {page: [] for page in LEGS}
    for _ in range(turns):
        for page in LEGS:
            spent, waited = leg(page, seconds)
            cpu[page] += spent
            late[page] += waited
    without = float(np.median(cpu["off"]))
    return [row(page, np.array(cpu[page]), np.array(late[page]), without=without, period=0.008) for page in LEGS]


def main() -> None:
    """The command."""
    options = options_of("benchmarks.viewer", __doc__, seconds=(10.0, "of each leg"), turns=(5, "legs of each kind"))
    load = os.getloadavg()[0]
    rows = by_turns(options.seconds, options.turns)
    heads = [
        f"page, load {load:.1f}",
        "ticks",
        "CPU p50, ms",
        "mean",
        "p99",
        "p50 / off",
        "late p50, ms",
        "p99",
        "longest",
    ]
    cells = [
        [
            one.page,
            str(one.ticks),
            *(f"{ms:.3f}" for ms in (one.cpu_p50, one.cpu_mean, one.cpu_p99, one.share)),
            *(f"{ms:.3f}" for ms in (one.late_p50, one.late_p99, one.longest)),
        ]
        for one in rows
    ]
    print_table(heads, cells)
    write_json(options.json, {"legs": rows})


if __name__ == "__main__":
    main()
