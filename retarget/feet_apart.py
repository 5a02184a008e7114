"""The feet of a robot that hangs, no closer to each other sideways than it stands.

Feet of performers pass each other within a hand's breadth, and cross; those of most robots are half as wide as their
hips are apart, and would meet. So what is asked of the left foot stays to the left of the right one's, at least by the
way between both in the stance. What is asked farther apart stays as it is, and the middle of both feet always does.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp

from retarget.profile import RobotProfile
from retarget.scalar_rotations import Vector
from retarget.stance import Stance

__all__ = ["FeetApart", "feet_apart"]

KNEE = 0.1
"""Share of the least distance above which nothing changes; in between it is approached smoothly."""


@dataclass(frozen=True)
class FeetApart:
    """Rows of the landmarks of the left and the right foot, and the least distance sideways between them, m."""

    left: int
    right: int
    least: float

    def ask(self, landmarks: list[Vector]) -> None:
        """Move both feet of `landmarks`, m, x forward and y left, aside in place, as far as they lack, each by half."""
        (lx, ly, lz), (rx, ry, rz) = landmarks[self.left], landmarks[self.right]
        half = 0.5 * (_at_least(ly - ry, self.least) - (ly - ry))
        landmarks[self.left], landmarks[self.right] = (lx, ly + half, lz), (rx, ry - half, rz)


def feet_apart(profile: RobotProfile, stance: Stance, rows: Sequence[str]) -> FeetApart | None:
    """Of a robot whose landmarks are `rows`; None where it does not have two feet among them, beside each other."""
    soles = {foot.frame for foot in profile.feet.values()}
    feet = [row for row, name in enumerate(rows) if profile.landmarks[name].frame in soles]
    if len(feet) != 2:
        return None
    beside = {row: float(stance.points[profile.landmarks[rows[row]].frame][1]) for row in feet}
    left, right = sorted(feet, key=lambda row: -beside[row])
    least = beside[left] - beside[right]
    return FeetApart(left, right, least) if least > 0.0 else None


def _at_least(value: float, least: float) -> float:
    """The value itself from a knee above `least` on; below, it approaches that smoothly."""
    room = KNEE * least
    lack = least + room - value
    return value if lack <= 0.0 else least + room * exp(-lack / room)
