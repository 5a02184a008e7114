"""Where a performer faces: the slow heading in which a planted robot mirrors the performer.

A robot whose feet stay planted cannot turn with the performer. It keeps its stance and takes what the performer does
relative to this heading, so a performer who turns round slowly is followed as one who faces forward, while a quick
twist of the trunk is a twist of the robot's trunk.
"""

from collections.abc import Sequence
from math import exp, hypot

from retarget.scalar_rotations import Quat

__all__ = ["Facing"]

SETTLE_S = 1.0
"""Time constant (s of the robot's clock) with which the heading follows: slower than a twist, faster than a stroll."""
CLEAR = 0.2
"""Length of the mean of the unit directions below which feet and pelvis tell no direction, and the heading is held."""


class Facing:
    """Mean ground direction of pelvis, left foot and right foot, through a first-order low pass.

    The pelvis counts as much as both feet: each alone misleads, the feet of a wide stance, the pelvis of a twist.
    """

    def __init__(self) -> None:
        self._x, self._y = 0.0, 0.0  # zero: not started

    def restart(self) -> None:
        """Take the next direction as it is."""
        self._x, self._y = 0.0, 0.0

    def update(
        self, pelvis: Quat, left_foot: Sequence[float], right_foot: Sequence[float], dt: float
    ) -> tuple[float, float]:
        """Heading (x, y), a unit vector on the ground, `dt` s after the last one.

        pelvis: orientation wxyz, forward where its left axis has it, so that bending does not matter; feet: x, y, z of
        any length, from ankle to toe. What is not finite takes no part.
        """
        x, y = _seen(pelvis, left_foot, right_foot)
        length = hypot(x, y)
        if length > CLEAR:
            started = self._x != 0.0 or self._y != 0.0
            share = 1.0 - exp(-dt / SETTLE_S) if started else 1.0
            self._x += share * (x / length - self._x)
            self._y += share * (y / length - self._y)
        norm = hypot(self._x, self._y)
        return (self._x / norm, self._y / norm) if norm > 1e-9 else (1.0, 0.0)


def _seen(pelvis: Quat, left_foot: Sequence[float], right_foot: Sequence[float]) -> tuple[float, float]:
    """Mean of the unit directions on the ground; shorter than one where they disagree."""
    w, qx, qy, qz = pelvis
    left_x, left_y = 2.0 * (qx * qy - w * qz), 1.0 - 2.0 * (qx * qx + qz * qz)
    x = y = 0.0
    for dx, dy, share in (
        (left_y, -left_x, 0.5),
        (left_foot[0], left_foot[1], 0.25),
        (right_foot[0], right_foot[1], 0.25),
    ):
        length = hypot(dx, dy)
        if 1e-6 < length < float("inf"):
            x += share * dx / length
            y += share * dy / length
    return x, y
