"""The way from where a robot was found to where following begins: no joint of it is faster than the profile lets it."""

from collections.abc import Sequence

import numpy as np

from retarget.approach import approach
from retarget.laid_within import laid_within
from retarget.paced_way import PacedWay
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray

__all__ = ["way_there"]


def way_there(
    robot: RobotBody, present: FloatArray, standing: FloatArray, arrival: Sequence[FloatArray], *, dt: float
) -> PacedWay:
    """From `present` (n,) rad to how it stands (n,), and on along an arrival (n,), tick by tick of `dt` s.

    The arrival is laid out in more ticks where a joint would exceed its share of speed, `speed_caps.approach`.
    """
    speed, joints = robot.profile.safety.speed_caps.approach, robot.joint_map
    there = [*approach(present, standing, joints, speed=speed, dt=dt)]
    rows = laid_within(
        np.array([standing, *arrival]), most=speed * joints.max_velocity * dt, change=joints.max_acceleration * dt**2
    )
    return PacedWay(np.array([present, *there, *rows[1:]]), dt=dt)
