"""Whether ticks begin when they should: one that is late is made up for by the goal that the servos still have."""

from math import inf

LATE = 1.25
"""Periods between two ticks from which on the second is late."""
LOST = 2.25
"""Periods from which on a goal was missing that one more could not stand for."""


class TickPace:
    """Counts ticks that come late. period: s, infinite: whatever comes is in time.

    missed: deadlines that passed without a tick. behind: whether two ticks in a row came late, or one by more than a
    period: then the goals are not those of now any more.
    """

    def __init__(self, period: float = inf) -> None:
        self.missed = 0
        self.behind = False
        self._period = period
        self._begun: float | None = None  # [s]
        self._was_late = False

    def restart(self) -> None:
        """The next tick is the first."""
        self._begun, self._was_late, self.behind = None, False, False

    def begin(self, now: float) -> float:
        """A tick begins at `now`, s. Returns how long ago the one before began, s; 0 for the first."""
        pause = 0.0 if self._begun is None else now - self._begun
        self._begun = now
        periods = pause / self._period
        late = periods > LATE
        if late:
            self.missed += max(round(periods) - 1, 1)
        self.behind = (late and self._was_late) or periods > LOST
        self._was_late = late
        return pause
