"""The last poses of every sensor, each with its time, in a ring of fixed size; what comes late finds its place."""

import numpy as np
from numpy.typing import NDArray

from retarget.rotations import FloatArray
from retarget.sources.stream_frame import Dropped

__all__ = ["EMPTY", "FOUR", "Index", "PoseRing"]

EMPTY = -1e9
"""Time (s) of a place that holds nothing: finite, so that it may be subtracted, and long before any clock started."""

FOUR = np.ones(4)
"""(values * values).dot(FOUR) is the quickest sum over rows of four."""
FOUR.flags.writeable = False

Index = NDArray[np.intp]


class PoseRing:
    """The newest `depth` poses of each of k sensors, in the order of their times.

    Places are counted through all sensors: sensor i has those from i depth on. newest (k): time of the newest pose, s.
    """

    def __init__(self, count: int, *, depth: int = 64) -> None:
        assert count > 0 and 1 < depth < 128
        self.newest = np.full(count, EMPTY)
        self._time = np.full((count, depth), EMPTY)
        self._position = np.full((count * depth, 3), np.nan)
        self._orientation = np.full((count * depth, 4), np.nan)
        self._flat_time = self._time.reshape(-1)
        self._oldest: Index = np.zeros(count, dtype=np.intp)
        self._first: Index = np.arange(count) * depth
        self._depth = depth
        self._ones = np.ones(depth, dtype=np.int8)

    def add(self, rows: Index, time: float, position: FloatArray, orientation: FloatArray, dropped: Dropped) -> float:
        """Store poses of m > 0 different sensors captured at one time (s); the newest time of these sensors before it.

        rows (m,), position (m, 3), orientation (m, 4). What is there already, or older than all that is kept, is
        counted in `dropped`.
        """
        newest: float = max(self.newest[rows].tolist())
        if time <= newest:
            late = time <= self.newest[rows]
            for i in late.nonzero()[0]:
                self._sort_in(int(rows[i]), time, position[i], orientation[i], dropped)
            rows, position, orientation = rows[~late], position[~late], orientation[~late]
        oldest = self._oldest[rows]
        place = self._first[rows] + oldest
        self._flat_time[place] = time
        self._position[place] = position
        self._orientation[place] = orientation
        self._oldest[rows] = (oldest + 1) % self._depth
        self.newest[rows] = time
        return newest

    def around(self, time: FloatArray | float) -> tuple[Index, Index]:
        """Places (k) of the newest poses at or before a time (k) or one for all, and of those that follow.

        Where there is none before, the first is the newest of all or empty; after the newest follows the oldest.
        """
        limit = time[:, None] if isinstance(time, np.ndarray) else time
        # All of the ring but what comes after the time, the empty places first.
        after = self._oldest + (self._time <= limit).view(np.int8).dot(self._ones)
        return self._first + (after - 1) % self._depth, self._first + after % self._depth

    def time(self, place: Index) -> FloatArray:
        """Times (k) of poses, s."""
        return np.asarray(self._flat_time.take(place))

    def position(self, place: Index) -> FloatArray:
        """Positions (k, 3) of poses, m."""
        return np.asarray(self._position.take(place, axis=0))

    def orientation(self, place: Index) -> FloatArray:
        """Orientations (k, 4) of poses, wxyz."""
        return np.asarray(self._orientation.take(place, axis=0))

    def clear(self) -> None:
        """Forget every pose."""
        self.newest[:] = EMPTY
        self._time[:] = EMPTY
        self._position[:] = np.nan
        self._orientation[:] = np.nan
        self._oldest[:] = 0

    def _sort_in(self, row: int, time: float, position: FloatArray, orientation: FloatArray, dropped: Dropped) -> None:
        """Store one pose that is not the newest, in the place of the oldest."""
        order = self._first[row] + (self._oldest[row] + np.arange(self._depth)) % self._depth
        times = self._flat_time[order]
        rank = int(np.searchsorted(times, time))
        if times[rank] == time:
            dropped.note("repeated")
        elif rank == 0:
            dropped.note("older than what is kept")
        else:
            for stored in (self._flat_time, self._position, self._orientation):
                stored[order[: rank - 1]] = stored[order[1:rank]]
            self._flat_time[order[rank - 1]] = time
            self._position[order[rank - 1]] = position
            self._orientation[order[rank - 1]] = orientation
