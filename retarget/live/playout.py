"""Sensors told at their own times, read at one: between frames, a little beyond the newest, then held."""

from dataclasses import dataclass
from enum import IntEnum
from math import exp, inf, isfinite

import numpy as np
from numpy.typing import NDArray

from retarget._solver import PoseRing
from retarget.live.clock_map import SlidingMinimum
from retarget.sources.stream_frame import Dropped
from retarget.types import BoolArray, FloatArray, IntArray

__all__ = ["DELAY_CAP_S", "How", "Played", "Playout", "PlayoutDelay"]


# How far behind the present a stream is played, so that what is late still arrives in time.

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


EXTRAPOLATION_S = 0.050
AHEAD_S = 0.100
"""A capture time so far after its arrival is a mistake."""


class How(IntEnum):
    """How a pose was found."""

    NONE = 0
    """Nothing was ever told: NaN."""
    INTERPOLATED = 1
    LATEST = 2
    """A pose as it was told: the newest, or the first of all while the playout has not reached it."""
    EXTRAPOLATED = 3
    HELD = 4
    """Nothing new for longer than may be extrapolated: where that ended."""


@dataclass(frozen=True, slots=True, eq=False)
class Played:
    """k sensors at one time. position (k, 3) m, orientation (k, 4) wxyz: NaN where never told, or not in that part.

    valid (k): told, and the sender has not said since that it is lost. age (k): s since the newest pose was captured,
    infinity where there is none. how (k): of `How`. time (k): s, local capture time of what is shown, never falling
    from read to read while how is not LATEST; NaN where there is none. Not to be written to.
    """

    position: FloatArray
    orientation: FloatArray
    valid: BoolArray
    age: FloatArray
    how: NDArray[np.int8]
    time: FloatArray


class Playout:
    """The playout buffer of k sensors. delay: None plays the newest as it is (latest wins, never extrapolated).

    While a stream is silent a sensor moves on for 50 ms with its last velocity (linear and angular) and then is held.
    When data resume, the next read shows the data, be it a leap from where the sensor was held: what follows must
    blend. A frame that was overtaken is sorted in; what was already played stays played.
    """

    def __init__(self, count: int, *, delay: PlayoutDelay | None = None, depth: int = 64) -> None:
        self.dropped = Dropped()
        self._delay = delay
        self._ring = PoseRing(count, depth=depth, extrapolation=EXTRAPOLATION_S)
        self._now = self._at = -inf

    @property
    def delay(self) -> float:
        """How far behind the last read was, s; 0 where the latest wins."""
        return 0.0 if self._delay is None else self._now - self._at if self._now > -inf else 0.0

    def push(
        self,
        rows: IntArray,
        time: float,
        position: FloatArray,
        orientation: FloatArray,
        valid: BoolArray,
        *,
        arrival: float,
    ) -> None:
        """Take poses of m different sensors captured at one time.

        rows (m,); time, arrival: s, local clock; position (m, 3) m, NaN where not told; orientation (m, 4) wxyz, of
        any sign, NaN where not told; valid (m,): False where the sender says that it has lost the sensor.
        """
        if not (isfinite(time) and time <= arrival + AHEAD_S):
            self.dropped.note("not a capture time")
            return
        position, orientation = np.ascontiguousarray(position), np.ascontiguousarray(orientation)
        newest, repeated, too_old = self._ring.push(rows, time, position, orientation, valid)
        if repeated:
            self.dropped.reasons["repeated"] += repeated
        if too_old:
            self.dropped.reasons["older than what is kept"] += too_old
        if self._delay is not None and newest is not None and time > newest:
            self._delay.note(arrival, lateness=arrival - time, gap=time - newest)

    def read(self, now: float) -> Played:
        """Every sensor at `now` (s, local; a time before that of the last read counts as that one) less the delay."""
        self._now = now = max(now, self._now)
        if self._delay is None:
            return Played(*self._ring.latest(now))
        self._at = max(self._at, now - self._delay.at(now))
        return Played(*self._ring.read(self._at, now))

    def clear(self) -> None:
        """Forget every pose; time does not go back."""
        self._ring.clear()
