"""Where the root of a robot is that stands on both soles or on either: the lower one is where it was planted."""

import numpy as np

from retarget import rotations
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from retarget.stance import Stance

__all__ = ["EitherSole"]

LOWER_M = 3e-5
"""A sole that is lower than the one before by more than this carries instead: less is rounding."""


class EitherSole:
    """Of one robot in a stance on two soles."""

    def __init__(self, robot: RobotBody, stance: Stance) -> None:
        self._robot, self._soles = robot, stance.soles
        self._frames = tuple(sole.frame.name for sole in stance.soles)
        self.restart()

    def restart(self) -> None:
        """It stands on both."""
        self._foot = 0

    def plant(self, q: FloatArray) -> FloatArray:
        """Move the root of a posture q (nq,). Returns how high (k,) m each sole is above the floor."""
        heights = self._stand_on(self._foot, q)
        lower = int(heights.argmin())
        if heights[lower] < heights[self._foot] - LOWER_M:
            self._foot = lower
            heights = self._stand_on(lower, q)
        return heights

    def _stand_on(self, foot: int, q: FloatArray) -> FloatArray:
        sole = self._soles[foot]
        at = self._robot.points(q[None], self._frames)[0]
        turned = self._robot.orientations(q[None], self._frames)[0, foot]
        turn = rotations.multiply(sole.orientation, rotations.conjugate(turned))
        q[:3] = sole.position + rotations.rotate(turn, q[:3] - at[foot])
        q[3:7] = rotations.normalise(rotations.multiply(turn, q[3:7]))
        moved = sole.position + rotations.rotate(turn, at - at[foot])
        return np.asarray(moved[:, 2])
