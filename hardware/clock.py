"""Clocks: real, virtual and paced. Everything else is given a `Clock`. `TickTiming` counts ticks that begin late."""

import time
from math import inf
from typing import Protocol


class Clock(Protocol):
    """Monotonic seconds, provided by the caller."""

    def now(self) -> float:
        """Return the time in s, from an arbitrary but fixed origin; never decreases."""

    def sleep_until(self, deadline: float) -> None:
        """Return at `deadline` (s on this clock), or at once when it has passed."""

    def idle(self) -> float:
        """Return the time in s, from an arbitrary origin, in which this process used no processor."""


class MonotonicClock:
    """The machine's monotonic clock, untouched by changes of the wall clock."""

    def now(self) -> float:
        """Return the machine's monotonic time in s."""
        return time.monotonic()

    def sleep_until(self, deadline: float) -> None:
        """Sleep (no busy wait) until `deadline`, in s."""
        remaining = deadline - time.monotonic()
        if remaining > 0.0:
            time.sleep(remaining)

    def idle(self) -> float:
        """Return the idle time in s, that of a machine that slept included."""
        return time.clock_gettime(time.CLOCK_BOOTTIME) - time.process_time()


class VirtualClock:
    """A clock that jumps: sleeping takes no time. For tests, and for files played as fast as the machine allows."""

    def __init__(self, start: float = 0.0) -> None:
        self._now = start
        self._busy = 0.0  # [s] that the process computed

    def now(self) -> float:
        """Return the virtual time in s."""
        return self._now

    def sleep_until(self, deadline: float) -> None:
        """Move the virtual time to `deadline` (s), never backwards."""
        self._now = max(self._now, deadline)

    def idle(self) -> float:
        """Return the virtual time in s that did not pass by `advance`."""
        return self._now - self._busy

    def advance(self, seconds: float) -> None:
        """Move the virtual time forward by `seconds` of computing. Raises ValueError for a negative or non-finite
        step."""
        if not 0.0 <= seconds < float("inf"):
            raise ValueError(f"a clock moves forward by a finite time; found {seconds} s")
        self._now += seconds
        self._busy += seconds


class PacedClock(VirtualClock):
    """A virtual clock that never runs faster than real time, for a simulated run that a person watches.

    Where the machine is too slow, virtual time passes more slowly: what is computed is the same on any machine.
    """

    def __init__(self, start: float = 0.0, *, wall: Clock | None = None) -> None:
        super().__init__(start)
        self._wall = MonotonicClock() if wall is None else wall
        self._behind = self._wall.now() - start  # [s] of real time, less that of this clock

    def sleep_until(self, deadline: float) -> None:
        """Move the virtual time to `deadline` (s), and return when real time has reached it. A delay is not made
        up."""
        super().sleep_until(deadline)
        self._behind = max(self._behind, self._wall.now() - self._now)
        self._wall.sleep_until(self._now + self._behind)


def today() -> str:
    """Return the day where the machine is, as 2026-12-31."""
    return time.strftime("%Y-%m-%d")


def wall_to_monotonic() -> int:
    """Return what to add to a stamp of the wall clock to have it on the machine's monotonic clock, in ns, as of now."""
    before = time.monotonic_ns()
    wall = time.time_ns()
    return (before + time.monotonic_ns()) // 2 - wall


def thread_cpu() -> float:
    """Return the CPU time of the calling thread in s: what a computation costs, whatever else the machine does."""
    return time.thread_time()


# Ticks that begin late. The servos still have a goal for one late tick.

LATE = 1.35
"""A tick is late if it begins more than this many periods after the one before."""
LOST = 1.1
"""Periods by which ticks in a row may be late in total: the goal that the servos have covers one missing goal."""


class TickTiming:
    """Counts late ticks. period: s; infinite: no tick is late."""

    def __init__(self, period: float = inf) -> None:
        self._period = period
        self._begun: float | None = None  # [s]
        self._late = 0.0  # periods, of ticks in a row

    @property
    def behind(self) -> bool:
        """Whether ticks in a row came so late that more than one goal is missing. Then the goals are out of date."""
        return self._late > LOST

    def begin(self, now: float) -> float:
        """Note a tick that begins at `now`, s. Return the time since the one before began, s; 0 for the first."""
        pause = 0.0 if self._begun is None else now - self._begun
        self._begun = now
        periods = pause / self._period
        late = periods > LATE
        self._late = self._late + periods - 1.0 if late else 0.0
        return pause
