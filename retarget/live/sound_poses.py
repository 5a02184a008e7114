"""Which poses are poses at all, each by itself: finite, in the room, a rotation, and vouched for by the sender."""

from dataclasses import dataclass

import numpy as np

from retarget.frames import BoolArray
from retarget.live.trust_limits import TrustLimits
from retarget.rotations import FloatArray

__all__ = ["NOT_A_ROTATION", "NOT_FINITE", "OUT_OF_RANGE", "UNTRACKED", "SoundPoses", "Verdict"]

UNTRACKED = "pose that the sender does not vouch for"
NOT_FINITE = "pose that is not finite"
NOT_A_ROTATION = "orientation that is no unit quaternion"
OUT_OF_RANGE = "position outside the room"


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """On m poses. sound (m,). oriented (m,): whether an orientation is given. outside (m,): refused for its place.
    reasons: how many were refused for what."""

    sound: BoolArray
    oriented: BoolArray
    outside: BoolArray
    reasons: tuple[tuple[str, int], ...] = ()


class SoundPoses:
    """Judges poses one by one; it remembers nothing of them."""

    def __init__(self, limits: TrustLimits) -> None:
        reach, turn = limits.reach, 1.0 + limits.norm_tolerance
        low = np.array([-reach, -reach, limits.low, -turn, -turn, -turn, -turn])
        high = np.array([reach, reach, limits.high, turn, turn, turn, turn])
        self._middle, self._half = 0.5 * (low + high), 0.5 * (high - low)
        self._low, self._high = low[:3], high[:3]
        self._norm = limits.norm_tolerance
        self._none = np.zeros(0, dtype=bool)

    def missing_turns(self, pose: FloatArray, tracked: BoolArray) -> BoolArray | None:
        """Which of m sound poses, (m, 7), come without an orientation, (m,), or (0,) where none does; None where one
        is not sound. Most are sound, and then nothing more is asked."""
        missing = self._none
        # Comparisons with NaN are False, so the question is what is good.
        good = np.count_nonzero(np.abs(pose - self._middle) <= self._half)
        if good != pose.size:
            unknown = np.isnan(pose)
            missing = unknown[:, 3]
            if good + np.count_nonzero(unknown) != pose.size:
                return None
        if np.count_nonzero(tracked) != len(pose):
            return None
        norm = np.sqrt(np.einsum("ij,ij->i", pose[:, 3:], pose[:, 3:]))
        turned = np.count_nonzero(np.abs(norm - 1.0) <= self._norm)
        if turned + np.count_nonzero(missing) != len(pose):
            return None
        return missing if good + 4 * np.count_nonzero(missing) == pose.size else None

    def judge(self, position: FloatArray, orientation: FloatArray, tracked: BoolArray) -> Verdict:
        """Of m poses, (m, 3) m, (m, 4) wxyz, (m,). A position is needed; an orientation may be missing: all NaN."""
        inside: BoolArray = np.logical_and.reduce((position >= self._low) & (position <= self._high), axis=1)
        missing: BoolArray = np.logical_and.reduce(np.isnan(orientation), axis=1)
        finite = np.isfinite(position).all(axis=1) & (missing | np.isfinite(orientation).all(axis=1))
        with np.errstate(over="ignore", invalid="ignore"):
            turned = np.abs(np.linalg.norm(orientation, axis=1) - 1.0) <= self._norm
        left = tracked & finite
        bad_turn = left & ~missing & ~turned
        left &= ~bad_turn
        outside = left & ~inside
        sound = left & inside
        counts = (
            (UNTRACKED, int(np.count_nonzero(~tracked))),
            (NOT_FINITE, int(np.count_nonzero(tracked & ~finite))),
            (NOT_A_ROTATION, int(np.count_nonzero(bad_turn))),
            (OUT_OF_RANGE, int(np.count_nonzero(outside))),
        )
        return Verdict(sound, ~missing, outside, reasons=tuple(count for count in counts if count[1]))
