"""How a pose was found, as `retarget._solver.PoseRing` counts it."""

from enum import IntEnum


class How(IntEnum):
    """The values of `Played.how`."""

    NONE = 0
    """No pose was ever sent: NaN."""
    INTERPOLATED = 1
    LATEST = 2
    """A pose as sent: the newest, or the first of all while the playout has not reached it."""
    EXTRAPOLATED = 3
    HELD = 4
    """No new pose for longer than may be extrapolated: the pose at the end of extrapolation."""
