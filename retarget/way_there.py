"""The way from where a robot was found to where following begins: no joint of it is faster than the profile lets it."""

from collections.abc import Sequence

import numpy as np

from hardware.errors import RetargetError, describe
from retarget.approach import approach
from retarget.follow import RobotPosture
from retarget.laid_within import laid_within
from retarget.paced_way import PacedWay
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray

__all__ = ["require_finite", "way_there"]


def require_finite(*postures: RobotPosture) -> None:
    """Refuse postures of which nobody knows all numbers, before the robot has torque. Raises RetargetError."""
    unknown = sum(not np.isfinite(one.q).all() for one in postures)
    if unknown:
        raise RetargetError(
            describe(
                what="the robot's posture where following begins is not known",
                where="solver",
                found=f"not finite in {unknown} of {len(postures)} postures on the way there",
                then="Begin again; if it stays, report it: nothing that you send may lead to it",
            )
        )


def way_there(robot: RobotBody, present: FloatArray, arrival: Sequence[FloatArray], *, dt: float) -> PacedWay:
    """From `present` (n,) rad to the first posture (n,) of an arrival, and on along it, tick by tick of `dt` s.

    The arrival is laid out in more ticks where a joint would exceed its share of speed, `speed_caps.approach`.
    """
    speed, joints = robot.profile.safety.speed_caps.approach, robot.joint_map
    there = [*approach(present, arrival[0], joints, speed=speed, dt=dt)]
    rows = laid_within(np.array(arrival), most=speed * joints.max_velocity * dt, change=joints.max_acceleration * dt**2)
    return PacedWay(np.array([present, *there, *rows[1:]]), dt=dt, straight=len(there))
