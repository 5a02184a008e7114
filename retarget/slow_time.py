"""A robot that goes slower: time goes by slower for it, so that speeds fall and all that can be stopped still can.

At a pace of 1/2 a tick of 8 ms is one of 4 ms to the robot. What keeps every limit in its own time keeps half of the
speeds and a quarter of the accelerations in ours.
"""

import numpy as np

from retarget.body import BodyModel
from retarget.joint_limits import JointLimits
from retarget.rotations import FloatArray

__all__ = ["SlowTime"]

STILL = 1e-4
"""[rad^2/s^2] A joint that is no faster than the root of this stands."""


class SlowTime:
    """How fast time goes by for one robot. pace: s of its own in a second, (0, 1]."""

    def __init__(self, body: BodyModel, limits: JointLimits) -> None:
        single, address = body.scalar_joints()
        bounded = single & np.isfinite(limits.lower) & np.isfinite(limits.upper) & (limits.max_acceleration > 0.0)
        self._dofs = np.flatnonzero(bounded)
        self._columns = address[self._dofs]
        self._lower, self._upper = limits.lower[self._dofs], limits.upper[self._dofs]
        self._twice = 2.0 * limits.max_acceleration[self._dofs]
        self.pace = 1.0

    def turn(self, pace: float, q: FloatArray, velocity: FloatArray) -> float:
        """Keep another pace if that can be. Returns the new pace over the one before.

        q (nq,), velocity (nv,) per s of its own. A slower robot brakes more gently: while a joint could not stop short
        of its limit any more, the pace stays.
        """
        change = pace / self.pace
        if change < 1.0:
            speed, angle = velocity[self._dofs] / change, q[self._columns]
            room = np.where(speed > 0.0, self._upper - angle, angle - self._lower)
            if (speed * speed > self._twice * np.maximum(room, 0.0) + STILL).any():
                return 1.0
        self.pace = pace
        return change
