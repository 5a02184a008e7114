"""The playout buffer, which evens out the jitter of a stream by a delay, and the One-Euro filters of its sensors."""

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

DELAY_CAP_S = 0.040
LATENESS_WINDOW_S, MOST_KEPT = 2.0, 512  # [s] over which the lateness of frames is measured, and most frames of it
IN_TIME = 0.95
"""Extrapolation bridges the rare later frame, which costs less than to wait for it."""
SHRINK_S = 1.0  # time constant; at the cap, time then plays 4 % fast, which is not visible
GAP_SHARE = 0.1  # of each new gap in the running mean


class PlayoutDelay:
    """The playout delay, s: the lateness of 95 % of the frames of the last 2 s, and the typical gap between frames."""

    def __init__(self) -> None:
        self._arrived = deque[tuple[float, float]]()  # arrival and lateness, s
        self._lateness: list[float] = []  # the same, the least first
        self._gap: float | None = None
        self._delay = 0.0
        self._now: float | None = None

    def note(self, arrival: float, *, lateness: float, gap: float) -> None:
        """Note the arrival of a frame. gap: s since the capture of the frame before."""
        arrived, ordered = self._arrived, self._lateness
        arrived.append((arrival, lateness))
        insort(ordered, lateness)
        while arrived[0][0] < arrival - LATENESS_WINDOW_S or len(arrived) > MOST_KEPT:
            del ordered[bisect_left(ordered, arrived.popleft()[1])]
        if gap < inf:
            gap = min(gap, DELAY_CAP_S)
            self._gap = gap if self._gap is None else self._gap + GAP_SHARE * (gap - self._gap)

    def at(self, now: float) -> float:
        """The delay, s, at `now`, s. Calls come in the order of time."""
        elapsed = 0.0 if self._now is None else max(0.0, now - self._now)
        self._now = now if self._now is None else max(now, self._now)
        if self._lateness:
            lateness = self._lateness[ceil(IN_TIME * len(self._lateness)) - 1]
            desired = min(DELAY_CAP_S, max(0.0, lateness) + (self._gap or 0.0))
            if desired >= self._delay:
                self._delay = desired
            else:
                self._delay = desired + (self._delay - desired) * exp(-elapsed / SHRINK_S)
        return self._delay


DEPTH = 64  # kept poses of each sensor
EXTRAPOLATION_S = 0.050  # longest, beyond the newest pose
WRONG_CAPTURE_S = 0.100  # a capture time farther after its arrival is wrong


@dataclass(frozen=True, slots=True, eq=False)
class PlayoutSample:
    """k sensors at one time, read only. position (k, 3) m, orientation (k, 4) wxyz: NaN where never sent.

    valid (k,): sent, and not reported lost since. age (k,): s since the newest capture. how (k,): see `PoseRing`. time
    (k,): s, local capture time, NaN for none.
    """

    position: FloatArray
    orientation: FloatArray
    valid: BoolArray
    age: FloatArray
    how: NDArray[np.int8]
    time: FloatArray


class Playout:
    """The playout buffer of k sensors. Without a delay it plays the newest pose.

    A sensor of a silent stream moves on for 50 ms at its last velocity and then stops. The next data show at once, even
    where they jump, so later stages must blend.
    """

    def __init__(self, count: int, *, delay: PlayoutDelay | None = None) -> None:
        self.dropped = Dropped()
        self._delay = delay
        self._ring = PoseRing(count, depth=DEPTH, extrapolation=EXTRAPOLATION_S)
        self._now = self._at = -inf

    @property
    def delay(self) -> float:
        """Delay of the last read, s; 0 without a playout delay."""
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
        """Take poses of m sensors captured at one time.

        rows (m,); time, arrival: s, local clock; position (m, 3) m and orientation (m, 4) wxyz, NaN where not sent;
        valid (m,): False where the sender has lost the sensor.
        """
        if not (isfinite(time) and time <= arrival + WRONG_CAPTURE_S):
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
        """Every sensor at `now` less the delay, s, but never earlier than the last read."""
        self._now = now = max(now, self._now)
        if self._delay is None:
            return PlayoutSample(*self._ring.latest(now))
        self._at = max(self._at, now - self._delay.at(now))
        return PlayoutSample(*self._ring.read(self._at, now))


# The One-Euro filter (Casiez, Roussel and Vogel, CHI 2012) is a first-order low-pass whose cutoff rises with the speed,
# the norm of the whole vector. An orientation is filtered by the rotation vector from the filtered one, as its own
# jumps at 180 degrees.

OFF, LIGHT = "off", "light"

Cutoffs = tuple[float, float, float]  # [Hz] at rest; its rise per m/s or rad/s; of the speed's own filter
SMOOTHINGS: dict[str, tuple[Cutoffs, Cutoffs] | None] = {
    OFF: None,
    LIGHT: ((4.0, 12.0, 1.0), (4.0, 3.0, 1.0)),
    "strong": ((1.0, 3.0, 1.0), (1.0, 1.0, 1.0)),
}
"""Cutoffs of positions and orientations. light: a resting hand trembles half as much, and lags by 10 ms at 1 m/s."""


def smoothing_delay(name: str, speed: float) -> float:
    """Group delay, s, of a smoothing at a speed, m/s: 1 / (2 pi cutoff)."""
    settings = SMOOTHINGS[name]
    if settings is None:
        return 0.0
    least, rises, _ = settings[0]
    return 1.0 / (2.0 * pi * (least + rises * speed))


def pose_filter(name: str, count: int) -> PoseFilter | None:
    """The filter of a name for `count` sensors, or None. Raises UsageError for an unknown name."""
    if name not in SMOOTHINGS:
        allowed, step = ", ".join(SMOOTHINGS), suggest(name, SMOOTHINGS)
        found = repr(name[:80])
        raise UsageError("unknown smoothing", where="--smoothing", found=found, allowed=allowed, next_step=step)
    settings = SMOOTHINGS[name]
    return None if settings is None else PoseFilter(count, position=settings[0], orientation=settings[1])
