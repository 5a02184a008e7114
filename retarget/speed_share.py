"""How much of a step a robot takes that is not to be faster than a share of what its servos can."""

import numpy as np

from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray

__all__ = ["SpeedShare", "taken_of"]

NO_STEP = 1e-12
"""rad; what moves less stands."""
CALM = 0.5
"""Pace at which a robot follows that is to be slow: a quarter of its acceleration leaves room to shorten steps."""


def taken_of(step: FloatArray, before: FloatArray, *, most: FloatArray, change: FloatArray) -> float:
    """The share (0, 1] of a step that is taken, so that no joint goes farther than `most`, all (n,) rad.

    before: the step that was taken last; change: most that steps in a row may differ, which `step` itself keeps. Who
    was faster than `most` slows down no faster than that.
    """
    size = np.abs(step)
    moving = size > NO_STEP
    if not (size > most).any():
        return 1.0
    within = float((most[moving] / size[moving]).min())
    ahead = np.copysign(1.0, step[moving]) * before[moving]  # as far as it goes the same way
    return min(1.0, max(within, float(((ahead - change[moving]) / size[moving]).max())))


class SpeedShare:
    """Steps of one robot in ticks of `dt` s, no joint faster than a share of its greatest speed."""

    def __init__(self, robot: RobotBody, *, dt: float) -> None:
        self._slow = robot.profile.safety.speed_caps.approach
        self._most = robot.joint_map.max_velocity * dt  # (n,) [rad]
        self._change = robot.joint_map.max_acceleration * dt**2  # (n,) [rad]
        self._columns = robot.servo_columns
        self._kinematics = robot.body.solver_body()

    def pace(self, settled: float) -> float:
        """Pace (0, 1] at which it follows."""
        return CALM + (1.0 - CALM) * settled

    def moved(self, here: FloatArray, there: FloatArray, last: FloatArray, *, settled: float) -> FloatArray | None:
        """The displacement (nv,) from posture `here` towards `there` (nq,), in which the speed is that of the slow
        approach, from there to all of it as `settled` goes to 1; None: all the way.

        last (n,): rad, what was moved in the tick before.
        """
        if settled >= 1.0:
            return None
        most = (self._slow + (1.0 - self._slow) * settled) * self._most
        step = there[self._columns] - here[self._columns]
        share = taken_of(step, last, most=most, change=self._change)
        if share >= 1.0:
            return None
        return np.asarray(share * self._kinematics.difference(here, there))
