"""The playout buffer: sensors sent at their own times, read at one time, with a delay that evens out jitter."""

from dataclasses import dataclass
from enum import IntEnum
from math import exp, inf, isfinite

import numpy as np
from numpy.typing import NDArray

from retarget._solver import PoseRing
from retarget.live.clock_map import SlidingMinimum
from retarget.sources.stream_frame import Dropped
from retarget.types import BoolArray, FloatArray, IntArray

# The playout delay: how far behind the present a stream is played, so that late frames still arrive in time.

DELAY_CAP_S = 0.040
WINDOW_S = 2.0
SHRINK_S = 1.0
"""Time constant of shrinking. At the cap, time then plays 4 % fast, which is not visible."""
GAP_SHARE = 0.1
"""Share of each new gap in the running mean."""


class PlayoutDelay:
    """The worst lateness (arrival - capture) of the last 2 s and a share of the time between frames, s.

    cap: the delay never exceeds it. periods: share of the typical time between two frames that is added, so that the
    later neighbour of a time that is read has arrived (0: about half of the reads go beyond the newest). The delay
    grows at once and shrinks slowly.
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
        """Note that a frame arrived. gap: s since the frame before it was captured; infinity for the first one."""
        self._earliness.add(arrival, -lateness)
        if gap < inf:
            gap = min(gap, self._cap)
            self._gap = gap if self._gap is None else self._gap + GAP_SHARE * (gap - self._gap)

    def at(self, now: float) -> float:
        """The delay at `now`, s. `now` must not fall from call to call."""
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
"""A capture time farther after its arrival than this is wrong."""


class How(IntEnum):
    """How a pose was found."""

    NONE = 0
    """No pose was ever sent: NaN."""
    INTERPOLATED = 1
    LATEST = 2
    """A pose as sent: the newest, or the first of all while the playout has not reached it."""
    EXTRAPOLATED = 3
    HELD = 4
    """No new pose for longer than may be extrapolated: the pose at the end of extrapolation."""


@dataclass(frozen=True, slots=True, eq=False)
class Played:
    """k sensors at one time. position (k, 3) m, orientation (k, 4) wxyz: NaN where never sent. Not to be written to.

    valid (k): the sender has sent the sensor, and has not reported it lost since. age (k): s since the newest pose was
    captured, infinity where there is none. how (k): of `How`. time (k): s, local capture time of the pose, never
    falling from read to read while how is not LATEST; NaN where there is none.
    """

    position: FloatArray
    orientation: FloatArray
    valid: BoolArray
    age: FloatArray
    how: NDArray[np.int8]
    time: FloatArray


class Playout:
    """The playout buffer of k sensors. delay: None plays the newest pose as it is, never extrapolated.

    While a stream is silent, a sensor moves on for 50 ms with its last velocity (linear and angular) and is then held.
    When data resume, the next read shows the data, also where they jump from where the sensor was held; later stages
    must blend. A frame that was overtaken is sorted in; what was already played stays played.
    """

    def __init__(self, count: int, *, delay: PlayoutDelay | None = None, depth: int = 64) -> None:
        self.dropped = Dropped()
        self._delay = delay
        self._ring = PoseRing(count, depth=depth, extrapolation=EXTRAPOLATION_S)
        self._now = self._at = -inf

    @property
    def delay(self) -> float:
        """How far behind the present the last read was, s; 0 without a delay."""
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

        rows (m,); time, arrival: s, local clock; position (m, 3) m, NaN where not sent; orientation (m, 4) wxyz, of
        any sign, NaN where not sent; valid (m,): False where the sender reports that it has lost the sensor.
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
        """Every sensor at `now` less the delay. now: s, local; a time before the last read's counts as the last."""
        self._now = now = max(now, self._now)
        if self._delay is None:
            return Played(*self._ring.latest(now))
        self._at = max(self._at, now - self._delay.at(now))
        return Played(*self._ring.read(self._at, now))

    def clear(self) -> None:
        """Forget every pose; time does not go back."""
        self._ring.clear()
