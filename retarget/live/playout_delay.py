"""How far behind the present a stream is played, so that what is late still arrives in time."""

from math import exp, inf

from retarget.live.sliding_minimum import SlidingMinimum

__all__ = ["DELAY_CAP_S", "PlayoutDelay"]

DELAY_CAP_S = 0.040
WINDOW_S = 2.0
SHRINK_S = 1.0
"""Time constant of shrinking: at the cap, time then plays 4 % fast, which nobody sees."""
GAP_SHARE = 0.1
"""Of each new gap in the typical one."""


class PlayoutDelay:
    """The worst lateness (arrival - capture) of the last 2 s and a share of the time between frames, s.

    cap: never more than this. periods: of the typical time between two frames, that the later of the two neighbours is
    there when a time between them is read (0: about half of the reads go beyond the newest). It grows at once and
    shrinks slowly.
    """

    def __init__(self, *, cap: float = DELAY_CAP_S, periods: float = 1.0) -> None:
        assert cap >= 0.0 and periods >= 0.0
        self._cap = cap
        self._periods = periods
        self._earliness = SlidingMinimum(WINDOW_S)
        self._gap: float | None = None
        self._delay = 0.0
        self._now: float | None = None

    def note(self, arrival: float, *, lateness: float, gap: float) -> None:
        """One frame arrived. gap: s since the frame before it was captured; infinity for the first one."""
        self._earliness.add(arrival, -lateness)
        if gap < inf:
            gap = min(gap, self._cap)
            self._gap = gap if self._gap is None else self._gap + GAP_SHARE * (gap - self._gap)

    def at(self, now: float) -> float:
        """The delay at a time that does not fall from call to call, s."""
        elapsed = 0.0 if self._now is None else max(0.0, now - self._now)
        self._now = now if self._now is None else max(now, self._now)
        earliness = self._earliness.at(self._now)
        if earliness < inf:
            wanted = min(self._cap, max(0.0, -earliness) + self._periods * (self._gap or 0.0))
            if wanted >= self._delay:
                self._delay = wanted
            else:
                self._delay = wanted + (self._delay - wanted) * exp(-elapsed / SHRINK_S)
        return self._delay
