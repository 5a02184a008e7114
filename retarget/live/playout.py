"""The playout buffer: sensors sent at their own times, read at one time, with a delay that evens out jitter; and their
smoothing, a One-Euro filter chosen by name.
"""

from bisect import bisect_left, insort
from collections import deque
from dataclasses import dataclass
from math import ceil, inf, isfinite, pi

import numpy as np
from numpy.typing import NDArray

from retarget._solver import PoseFilter, PoseRing
from retarget.arithmetic import exp
from retarget.errors import UsageError, suggest
from retarget.sources.streams.stream_frame import Dropped
from retarget.types import BoolArray, FloatArray, IntArray

# The playout delay: how far behind the present a stream is played, so that late frames still arrive in time.

DELAY_CAP_S = 0.040
WINDOW_S, MOST_KEPT = 2.0, 512
"""Time, s, over which the lateness of frames is measured, and the most frames of it."""
IN_TIME = 0.95
"""Share of the frames that are to arrive in time. A rare one that is later is bridged by extrapolation, which costs
less than to wait with all others for it."""
SHRINK_S = 1.0
"""Time constant of shrinking. At the cap, time then plays 4 % fast, which is not visible."""
GAP_SHARE = 0.1
"""Share of each new gap in the running mean."""


class PlayoutDelay:
    """The lateness (arrival - capture) of the last 2 s, that of all but one frame in twenty, and the typical time
    between two frames, s: so the later neighbour of a time that is read has arrived. The delay grows at once and
    shrinks slowly, and is at most the cap.
    """

    def __init__(self) -> None:
        self._arrived = deque[tuple[float, float]]()  # arrival and lateness, s
        self._lateness: list[float] = []  # the same, the least first
        self._gap: float | None = None
        self._delay = 0.0
        self._now: float | None = None

    def note(self, arrival: float, *, lateness: float, gap: float) -> None:
        """Note that a frame arrived. gap: s since the frame before it was captured; infinity for the first one."""
        arrived, ordered = self._arrived, self._lateness
        arrived.append((arrival, lateness))
        insort(ordered, lateness)
        while arrived[0][0] < arrival - WINDOW_S or len(arrived) > MOST_KEPT:
            del ordered[bisect_left(ordered, arrived.popleft()[1])]
        if gap < inf:
            gap = min(gap, DELAY_CAP_S)
            self._gap = gap if self._gap is None else self._gap + GAP_SHARE * (gap - self._gap)

    def at(self, now: float) -> float:
        """The delay at `now`, s. `now` must not fall from call to call."""
        elapsed = 0.0 if self._now is None else max(0.0, now - self._now)
        self._now = now if self._now is None else max(now, self._now)
        if self._lateness:
            lateness = self._lateness[ceil(IN_TIME * len(self._lateness)) - 1]
            wanted = min(DELAY_CAP_S, max(0.0, lateness) + (self._gap or 0.0))
            if wanted >= self._delay:
                self._delay = wanted
            else:
                self._delay = wanted + (self._delay - wanted) * exp(-elapsed / SHRINK_S)
        return self._delay


DEPTH = 64
"""Poses of each sensor that are kept."""
EXTRAPOLATION_S = 0.050
AHEAD_S = 0.100
"""A capture time farther after its arrival than this is wrong."""


@dataclass(frozen=True, slots=True, eq=False)
class PlayoutSample:
    """k sensors at one time. position (k, 3) m, orientation (k, 4) wxyz: NaN where never sent. Not to be written to.

    valid (k): the sender has sent the sensor, and has not reported it lost since. age (k): s since the newest pose was
    captured, infinity where there is none. how (k): see `PoseRing`. time (k): s, local capture time of the pose, never
    falling from read to read while it is not as sent; NaN where there is none.
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

    def __init__(self, count: int, *, delay: PlayoutDelay | None = None) -> None:
        self.dropped = Dropped()
        self._delay = delay
        self._ring = PoseRing(count, depth=DEPTH, extrapolation=EXTRAPOLATION_S)
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

    def read(self, now: float) -> PlayoutSample:
        """Every sensor at `now` less the delay. now: s, local; a time before the last read's counts as the last."""
        self._now = now = max(now, self._now)
        if self._delay is None:
            return PlayoutSample(*self._ring.latest(now))
        self._at = max(self._at, now - self._delay.at(now))
        return PlayoutSample(*self._ring.read(self._at, now))


# Smoothing: the One-Euro filter (Casiez, Roussel and Vogel, CHI 2012).
#
# It is a low-pass filter of first order whose cutoff rises with the speed: strong at rest, weak in
# motion. The speed is the norm of the whole vector, so that turning the world turns the result, and nothing else. An
# orientation is filtered by the rotation vector from the filtered orientation to the new one, in world axes, and not by
# its own rotation vector, which jumps at 180 degrees. So the signs of quaternions do not matter.

OFF, LIGHT = "off", "light"

Cutoffs = tuple[float, float, float]
"""One-Euro filter: cutoff at rest, Hz; Hz by which it rises per m/s or rad/s; cutoff of the speed's own filter, Hz."""
SMOOTHINGS: dict[str, tuple[Cutoffs, Cutoffs] | None] = {
    OFF: None,
    LIGHT: ((4.0, 12.0, 1.0), (4.0, 3.0, 1.0)),
    "strong": ((1.0, 3.0, 1.0), (1.0, 1.0, 1.0)),
}
"""Cutoffs by name, of positions and of orientations. light: a hand at rest trembles half as much, and one that moves at
1 m/s lags by 10 ms."""


def smoothing_delay(name: str, speed: float) -> float:
    """The group delay, s, of the smoothing of this name on a position that moves at a speed, m/s: 1 / (2 pi cutoff), of
    a low-pass filter of first order."""
    settings = SMOOTHINGS[name]
    if settings is None:
        return 0.0
    least, rises, _ = settings[0]
    return 1.0 / (2.0 * pi * (least + rises * speed))


def pose_filter(name: str, count: int) -> PoseFilter | None:
    """The filter of this name for `count` sensors; None for no smoothing. Raises UsageError for an unknown name."""
    if name not in SMOOTHINGS:
        allowed, step = ", ".join(SMOOTHINGS), suggest(name, SMOOTHINGS)
        found = repr(name[:80])
        raise UsageError("unknown smoothing", where="--smoothing", found=found, allowed=allowed, next_step=step)
    settings = SMOOTHINGS[name]
    return None if settings is None else PoseFilter(count, position=settings[0], orientation=settings[1])
