"""Clocks: real, virtual and paced. All other modules receive a `Clock`. `TickTiming` counts late ticks."""

import time
from math import inf
from typing import Protocol


class Clock(Protocol):
    """Monotonic seconds, provided by the caller."""

    def now(self) -> float:
        """The time, s, from an arbitrary fixed origin."""

    def sleep_until(self, deadline: float) -> None:
        """Return at `deadline`, s."""

    def idle(self) -> float:
        """The time, s, during which this process used no processor."""


class MonotonicClock:
    """The machine's monotonic clock."""

    def now(self) -> float:
        """See `Clock`."""
        return time.monotonic()

    def sleep_until(self, deadline: float) -> None:
        """Sleep without a busy wait."""
        remaining = deadline - time.monotonic()
        if remaining > 0.0:
            time.sleep(remaining)

    def idle(self) -> float:
        """See `Clock`; includes suspension of the machine."""
        return time.clock_gettime(time.CLOCK_BOOTTIME) - time.process_time()


class VirtualClock:
    """A clock on which sleeping takes no time."""

    def __init__(self, start: float = 0.0) -> None:
        self._now = start
        self._busy = 0.0  # [s] that the process computed

    def now(self) -> float:
        """See `Clock`."""
        return self._now

    def sleep_until(self, deadline: float) -> None:
        """Move the time to `deadline`, never backwards."""
        self._now = max(self._now, deadline)

    def idle(self) -> float:
        """The time, s, that did not pass by `advance`."""
        return self._now - self._busy

    def advance(self, seconds: float) -> None:
        """Move the time forward by `seconds` of computing."""
        if not 0.0 <= seconds < float("inf"):
            raise ValueError(f"a clock moves forward by a finite time; found {seconds} s")
        self._now += seconds
        self._busy += seconds


class PacedClock(VirtualClock):
    """A virtual clock that never runs faster than real time, and slower on a slow machine, with the same results."""

    def __init__(self, start: float = 0.0, *, wall: Clock | None = None) -> None:
        super().__init__(start)
        self._wall = MonotonicClock() if wall is None else wall
        self._behind = self._wall.now() - start  # [s] of real time, less that of this clock

    def sleep_until(self, deadline: float) -> None:
        """Return once real time has reached `deadline` too. Delays are not made up."""
        super().sleep_until(deadline)
        self._behind = max(self._behind, self._wall.now() - self._now)
        self._wall.sleep_until(self._now + self._behind)


def today() -> str:
    """The local date, as 2026-12-31."""
    return time.strftime("%Y-%m-%d")


def wall_to_monotonic() -> int:
    """The offset, ns, from wall-clock to monotonic time."""
    before = time.monotonic_ns()
    wall = time.time_ns()
    return (before + time.monotonic_ns()) // 2 - wall


def thread_cpu() -> float:
    """The CPU time of the calling thread, s."""
    return time.thread_time()


LATE = 1.35
"""Periods since the previous tick above which a tick is late."""
LOST = 1.1
"""Total delay of consecutive late ticks, periods, that a goal covers."""


class TickTiming:
    """Counts late ticks. period: s."""

    def __init__(self, period: float = inf) -> None:
        self._period = period
        self._begun: float | None = None  # [s]
        self._late = 0.0  # periods, of ticks in a row

    @property
    def behind(self) -> bool:
        """True if consecutive late ticks miss more than one goal."""
        return self._late > LOST

    def begin(self, now: float) -> float:
        """Note a tick at `now`, s. Return the time since the previous one, s."""
        pause = 0.0 if self._begun is None else now - self._begun
        self._begun = now
        periods = pause / self._period
        late = periods > LATE
        self._late = self._late + periods - 1.0 if late else 0.0
        return pause
