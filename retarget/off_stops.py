"""Joints that carry a robot keep off the ends of their range: a servo overshoots, and a stop that it hits throws the
robot off its soles."""

from dataclasses import replace

import numpy as np

from retarget.joint_limits import JointLimits
from retarget.robot_body import RobotBody
from retarget.robot_reader import standing_dofs

__all__ = ["off_stops"]

MOST_SHARE = 0.25
"""Of a joint's range that it may lose at an end."""


def off_stops(robot: RobotBody, limits: JointLimits, *, margin: float) -> JointLimits:
    """Limits (nv,) with the joints between root and soles kept `margin` rad off both ends of the range of their servos,
    MOST_SHARE of it at most, and as far as `stand` allows. A robot that does not stand keeps its limits."""
    if not robot.stands or margin == 0.0:
        return limits
    lower, upper = limits.lower.copy(), limits.upper.copy()
    stand = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
    dofs = np.array([robot.body.dof_index(joint) for joint in robot.joint_map.joints], dtype=np.intp)
    carrying = standing_dofs(robot)[dofs]
    rows = dofs[carrying]
    first, last = robot.limits.lower[carrying], robot.limits.upper[carrying]
    off = np.minimum(margin, MOST_SHARE * (last - first))
    lowest, highest = first + off, last - off
    stand = stand[carrying]
    lower[rows] = np.maximum(lower[rows], np.minimum(lowest, stand))
    upper[rows] = np.minimum(upper[rows], np.maximum(highest, stand))
    return replace(limits, lower=lower, upper=upper)
