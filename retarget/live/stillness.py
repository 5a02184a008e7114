"""Which sensors repeat one value while others move."""

import numpy as np

from retarget.frames import BoolArray
from retarget.live.last_poses import LastPoses
from retarget.live.trust_limits import TrustLimits
from retarget.rotations import FloatArray

__all__ = ["Stillness"]

EARLY = 0.5
"""From this share of the time on that makes a sensor frozen, one looks whether others move: they must do so for the
rest of it."""
SNAPSHOTS = 8
SNAPSHOT_S = 0.04
"""Poses are remembered for the last SNAPSHOTS * SNAPSHOT_S seconds."""


class Stillness:
    """Watches k sensors by capture time; repeats of one capture are no evidence.

    What is watched of a sensor is its orientation, for a lost tracker of a chain keeps its orientation while its
    position is carried along (SlimeVR); its position where there is no orientation, or one that was never seen to
    change. A value that stays is suspect only where most of the others change: made motion without noise also stays.
    """

    def __init__(self, last: LastPoses, limits: TrustLimits) -> None:
        self._last = last
        self._limits = limits
        self._frozen = np.zeros(len(last.at), dtype=bool)
        self._snapshots = np.full((SNAPSHOTS, *last.pose.shape), np.nan)
        self._taken = -np.inf
        self._next = 0
        self._moving_since = np.inf

    def remember(self, time: float) -> None:
        """Note where everybody is, from time to time."""
        if abs(time - self._taken) >= SNAPSHOT_S:
            self._snapshots[self._next] = self._last.pose
            self._next = (self._next + 1) % SNAPSHOTS
            self._taken = time

    def frozen(self, now: float) -> BoolArray | None:
        """Which sensors are frozen, (k,); None: none."""
        since = self._since()
        latest, long = self._last.latest, self._limits.frozen_after
        if not np.count_nonzero(since <= latest - EARLY * long):
            self._frozen[:] = False
            return None
        still = self._still_for(since)
        if not np.count_nonzero((still >= EARLY * long) & ~self._frozen):
            self._frozen &= still >= long
            return self._frozen
        self._moving_since = min(self._moving_since, latest) if self._others_move(still, now) else np.inf
        suspect = still >= long
        if latest - self._moving_since < (1.0 - EARLY) * long:
            suspect &= self._frozen
        self._frozen = suspect
        return suspect

    def still_for(self) -> FloatArray:
        """How long each sensor has repeated its value, s (k,); NaN where nothing is known."""
        return self._still_for(self._since())

    def _since(self) -> FloatArray:
        """Of position and orientation, (k, 2): the last change of any number that ever changed."""
        return np.asarray(np.fmax.reduceat(self._last.since, (0, 3), axis=1))

    def _still_for(self, since: FloatArray) -> FloatArray:
        return np.asarray(self._last.at - np.where(np.isnan(since[:, 1]), since[:, 0], since[:, 1]))

    def _others_move(self, still: FloatArray, now: float) -> bool:
        """Whether most of the sensors change, seen from one that does not, and one of them by more than noise."""
        heard = np.abs(now - self._last.at) <= self._limits.stale_after
        alive = heard & (still <= EARLY * self._limits.frozen_after)
        if 2 * np.count_nonzero(alive) <= np.count_nonzero(heard) - 1:
            return False
        pose, past = self._last.pose[alive], self._snapshots[:, alive]
        moved = (np.abs(pose - past)[..., :3] > self._limits.noticeable[0]).any()
        turned = np.minimum(np.abs(pose - past), np.abs(pose + past))[..., 3:] > self._limits.noticeable[1]
        return bool(moved or turned.any())
