"""Why a pose is none, by itself: not finite, not in the room, no rotation, or not vouched for by the sender."""

__all__ = ["NOT_A_ROTATION", "NOT_FINITE", "OUT_OF_RANGE", "REASONS", "SOUND", "UNTRACKED"]

SOUND = 0
"""The verdict of `WatchedSensors` on a pose that is one."""
UNTRACKED = "pose that the sender does not vouch for"
NOT_FINITE = "pose that is not finite"
NOT_A_ROTATION = "orientation that is no unit quaternion"
OUT_OF_RANGE = "position outside the room"
REASONS = {1: UNTRACKED, 2: NOT_FINITE, 3: NOT_A_ROTATION, 4: OUT_OF_RANGE}
"""What every other verdict says; the first of these where several hold."""
