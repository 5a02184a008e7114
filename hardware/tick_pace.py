"""Whether ticks begin when they should: one that is late is made up for by the goal that the servos still have."""

from math import inf

LATE = 1.35
"""Periods between two ticks from which on the second is late."""
LOST = 1.1
"""Periods by which ticks in a row may be late, in all: the goal that the servos have stands for one that is missing."""


class TickPace:
    """Knows which ticks come late. period: s, infinite: whatever comes is in time.

    behind: whether ticks in a row came so late that a goal was
    missing, and the next one too: then the goals are not those of now any more.
    """

    def __init__(self, period: float = inf) -> None:
        self.behind = False
        self._period = period
        self._begun: float | None = None  # [s]
        self._late = 0.0  # periods, of ticks in a row

    def restart(self) -> None:
        """The next tick is the first."""
        self._begun, self._late, self.behind = None, 0.0, False

    def begin(self, now: float) -> float:
        """A tick begins at `now`, s. Returns how long ago the one before began, s; 0 for the first."""
        pause = 0.0 if self._begun is None else now - self._begun
        self._begun = now
        periods = pause / self._period
        late = periods > LATE
        self._late = self._late + periods - 1.0 if late else 0.0
        self.behind = self._late > LOST
        return pause
