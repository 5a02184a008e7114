"""Sensors told at their own times, read at one: between frames, a little beyond the newest, then held."""

from dataclasses import dataclass
from enum import IntEnum
from math import inf, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget._solver import along_arc
from retarget.frames import BoolArray
from retarget.live.playout_delay import PlayoutDelay
from retarget.live.pose_ring import EMPTY, FOUR, Index, PoseRing
from retarget.rotations import FloatArray
from retarget.sources.stream_frame import Dropped

__all__ = ["How", "Played", "Playout"]

EXTRAPOLATION_S = 0.050
BASELINE_S = 0.020
"""The velocity that is extrapolated is that since a frame at least this much older: noise of 1 mm is then 0.05 m/s."""
LONGEST_S = 0.200
"""And at most this: what was longer ago says nothing of the velocity now."""
AHEAD_S = 0.100
"""A capture time so far after its arrival is a mistake."""
FAR_M = 1e4
"""Nobody is further from the origin: something else was told."""


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
        self._ring = PoseRing(count, depth=depth)
        self._lost_since = np.full(count, np.inf)
        self._has_lost = False
        self._shown = np.zeros((count, 4))
        self._has_all = False
        self._yes = _constant(count, True, np.bool_)
        self._interpolated = _constant(count, How.INTERPOLATED, np.int8)
        self._now = self._at = -inf

    @property
    def delay(self) -> float:
        """How far behind the last read was, s; 0 where the latest wins."""
        return 0.0 if self._delay is None else self._now - self._at if self._now > -inf else 0.0

    def push(
        self,
        rows: Index,
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
        if not _is_whole(position, orientation, valid):
            use, position, orientation = _usable(position, orientation, valid)
            self._lose(rows[~use], time)
            rows, position, orientation = rows[use], position[use], orientation[use]
        if rows.size == 0:
            return
        size = (orientation * orientation).dot(FOUR)
        newest = self._ring.add(rows, time, position, orientation / np.sqrt(size)[:, None], self.dropped)
        if self._delay is not None and time > newest:
            gap = time - newest if newest > EMPTY else inf
            self._delay.note(arrival, lateness=arrival - time, gap=gap)
        if not self._has_all:
            self._has_all = bool((self._ring.newest > EMPTY).all())
        if self._has_lost:
            self._lost_since[rows[time >= self._lost_since[rows]]] = np.inf
            self._has_lost = bool(np.isfinite(self._lost_since).any())

    def read(self, now: float) -> Played:
        """Every sensor at `now` (s, local; a time before that of the last read counts as that one) less the delay."""
        self._now = now = max(now, self._now)
        if self._delay is None:
            return self._latest(now)
        self._at = max(self._at, now - self._delay.at(now))
        return self._buffered(self._at)

    def clear(self) -> None:
        """Forget every pose; time does not go back."""
        self._ring.clear()
        self._lost_since[:] = np.inf
        self._has_lost = self._has_all = False
        self._shown = np.zeros_like(self._shown)

    def _latest(self, now: float) -> Played:
        """The newest poses."""
        ring = self._ring
        place, _ = ring.around(inf)
        how = np.where(now - ring.newest <= EXTRAPOLATION_S, _LATEST, _HELD)
        orientation = self._aligned(ring.orientation(place))
        return self._played(now, ring.position(place), orientation, how=how, time=ring.newest.copy())

    def _buffered(self, at: float) -> Played:
        """The poses at a time."""
        ring = self._ring
        first, second = ring.around(at)
        start, end = ring.time(first), ring.time(second)
        # Least values by way of lists: the quickest on so few.
        if min(end.tolist()) > at and min(start.tolist()) > EMPTY:
            time, how = np.full(len(end), at), self._interpolated
        else:
            between = (end > at) & (start > EMPTY)
            early = end > at  # and nothing before: playing has not reached the first pose
            second = np.where(early, second, first)
            end = ring.time(second)
            behind, _ = ring.around(end - BASELINE_S)
            is_moving = ~early & (ring.time(behind) >= end - LONGEST_S)
            first = np.where(between, first, np.where(is_moving, behind, second))
            start = ring.time(first)
            time = np.where(between, at, np.where(early, end, np.minimum(at, end + EXTRAPOLATION_S)))
            beyond = np.where(at > end + EXTRAPOLATION_S, _HELD, np.where(is_moving, _EXTRAPOLATED, _LATEST))
            how = np.where(between, _INTERPOLATED, np.where(early | (time == end), _LATEST, beyond))
            end = np.maximum(end, start + _LEAST_SPAN)
        share = (time - start) / (end - start)
        a, b = ring.position(first), ring.position(second)
        position = a + share[:, None] * (b - a)
        orientation = self._aligned(along_arc(ring.orientation(first), ring.orientation(second), share))
        return self._played(at, position, orientation, how=how, time=time)

    def _played(
        self, at: float, position: FloatArray, orientation: FloatArray, *, how: NDArray[np.int8], time: FloatArray
    ) -> Played:
        """With what was never told marked so, and what was lost."""
        newest = self._ring.newest
        age = np.maximum(self._now - newest, 0.0)
        if self._has_all:
            told = self._yes
        else:
            told = newest > EMPTY
            age, time = np.where(told, age, np.inf), np.where(told, time, np.nan)
            how = np.where(told, how, _NONE)
        valid = told & (self._lost_since > at) if self._has_lost else told
        return Played(position, orientation, valid, age, how, time)

    def _lose(self, rows: Index, time: float) -> None:
        """The sender says that these are lost."""
        news = rows[time > self._ring.newest[rows]]
        if news.size:
            self._lost_since[news] = np.minimum(self._lost_since[news], time)
            self._has_lost = True

    def _aligned(self, orientation: FloatArray) -> FloatArray:
        """The same orientations (k, 4), in the hemisphere of what was shown last."""
        orientation *= np.copysign(1.0, (orientation * self._shown).dot(FOUR))[:, None]
        self._shown = orientation
        return orientation


_NONE, _INTERPOLATED, _LATEST, _EXTRAPOLATED, _HELD = (np.int8(how) for how in How)
_LEAST_SPAN = 1e-3
"""s: between a pose and itself, of whose difference, nothing, a share is then taken."""


def _constant(count: int, value: int, kind: type[np.generic]) -> NDArray[Any]:
    """A read-only array."""
    values = np.full(count, value, dtype=kind)
    values.flags.writeable = False
    return values


def _is_whole(position: FloatArray, orientation: FloatArray, valid: BoolArray) -> bool:
    """Whether all rows have all parts, so that nothing needs sifting: the common case, in few operations."""
    # NaN and infinity spread into the sum; unlike `dot`, `vdot` warns of nothing.
    if False in valid.tolist() or not np.vdot(position, position) + np.vdot(orientation, orientation) < FAR_M**2:
        return False
    return min((orientation * orientation).dot(FOUR).tolist(), default=1.0) > 0.01


def _usable(
    position: FloatArray, orientation: FloatArray, valid: BoolArray
) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Which rows (m) are poses, with every part that is not whole as NaN. One part is enough."""
    has_position = np.asarray((np.abs(position) < FAR_M).all(axis=1))
    size = np.abs(orientation).max(axis=1)
    has_orientation = np.asarray((size > 0.1) & (size < 10.0))
    # A part that is missing is NaN throughout; any other that is not whole makes the pose suspect.
    broken = ~has_position & ~np.isnan(position).all(axis=1)
    broken |= ~has_orientation & ~np.isnan(orientation).all(axis=1)
    use = np.asarray(valid & ~broken & (has_position | has_orientation))
    return (
        use,
        np.where(has_position[:, None], position, np.nan),
        np.where(has_orientation[:, None], orientation, np.nan),
    )
