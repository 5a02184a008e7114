"""The last accepted pose of each sensor, how it got there, and since when each of its numbers has not changed."""

import numpy as np

from retarget.body import IntArray
from retarget.rotations import FloatArray

__all__ = ["SAME", "LastPoses", "Rows"]

Rows = IntArray | slice
"""Some sensors by their rows, or all of them in order."""

SAME = 1e-6
"""Numbers that differ less (m, parts of a unit quaternion) are the same: an orientation that was composed of others in
float32 wavers by 3e-7. The noise of an inertial sensor exceeds this within one sample, that of optical ones by far."""
CARRIED_S = 0.1
"""A step that took longer says nothing of how a sensor moves now."""


class LastPoses:
    """Of k sensors, by capture time. pose (k, 7): position m and orientation wxyz, NaN where unknown. at, before (k,):
    s, of this pose and the one before. step (k, 7): from that one. since (k, 7): s, the last change of each number; NaN
    where it was never seen to change, but for the first position. latest: the greatest `at`."""

    def __init__(self, count: int) -> None:
        self.pose = np.full((count, 7), np.nan)
        self.step = np.zeros((count, 7))
        self.at = np.full(count, -np.inf)
        self.before = np.full(count, -np.inf)
        self.since = np.full((count, 7), np.nan)
        self.latest = -np.inf
        self._all = np.arange(count).tobytes()

    def rows(self, rows: IntArray) -> Rows:
        """The same rows (m,), as a slice where they are all: indexing by it costs a third."""
        return slice(None) if rows.tobytes() == self._all else rows

    def go_on(self, rows: Rows, time: float, pose: FloatArray, step: FloatArray) -> None:
        """Poses (m, 7) later than `latest`, after calm steps (m, 7) from known ones."""
        changed = np.abs(step) > SAME
        if isinstance(rows, slice):
            np.putmask(self.since, changed, time)
        else:
            since = self.since[rows]
            np.putmask(since, changed, time)
            self.since[rows] = since
        self.pose[rows] = pose
        self.step[rows] = step
        self.before[rows] = self.at[rows]
        self.at[rows] = self.latest = time

    def put(self, rows: IntArray, time: float, pose: FloatArray) -> None:
        """Any poses (m, 7): the first of a sensor, after a leap, on a clock that was set back."""
        if len(rows) == 0:
            return
        step = pose - self.pose[rows]
        new = np.isnan(step[:, 0])
        carried = np.abs(time - self.at[rows]) <= CARRIED_S
        self.go_on(rows, time, pose, np.where(carried[:, None], step, 0.0))
        self.since[rows] = np.where(np.abs(step) > SAME, time, self.since[rows])
        self.since[rows[new], :3] = time
        self.latest = float(self.at.max())

    def forget_turn(self, rows: Rows | IntArray) -> None:
        """These sensors come without an orientation now."""
        self.since[rows, 3:] = np.nan
