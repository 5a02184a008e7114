"""The pelvis of a performer on one foot: over that foot, and as high above it as the leg holds it.

Measured from the middle of both ankles, who lifts a foot would seem to crouch by half of that. Fore and aft a walker's
feet are at both ends of a stride, and a robot that steps in place has none: there the pelvis is over what it is nearer
to, the foot or the middle.
"""

from math import exp

from retarget.carrying_feet import Carrying
from retarget.rotations import FloatArray
from retarget.scalar_rotations import Vector

__all__ = ["PelvisOverFoot"]

SETTLE_S = 0.2
"""Time constant (s) with which the pelvis goes from both feet to one, and back."""
_SIDE = {Carrying.LEFT: 1.0, Carrying.RIGHT: -1.0}


class PelvisOverFoot:
    """How far a pelvis is from where the middle of both ankles would have it, in the robot's world and size."""

    def __init__(self, left: FloatArray, right: FloatArray) -> None:
        """left, right (3,) m: ankles of the standing robot."""
        self._aside = float(left[1] - right[1])
        self.restart()

    def restart(self) -> None:
        """On both feet."""
        self._side = 0.0

    def step(self, pelvis: Vector, apart: Vector, carrying: Carrying, dt: float) -> Vector:
        """Offset (m) after another `dt` s. pelvis: from the middle of both ankles, apart: the performer's left ankle
        from the right one; both scaled as a leg, m."""
        self._side += (1.0 - exp(-dt / SETTLE_S)) * (_SIDE.get(carrying, 0.0) - self._side)
        half = 0.5 * self._side
        ahead = pelvis[0]
        nearer = sorted((ahead, ahead - half * apart[0], 0.0))[1]
        return nearer - ahead, half * (self._aside - apart[1]), -half * apart[2]
