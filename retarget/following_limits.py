"""The limits within which a robot follows: those of its servos, and knees that never get quite straight."""

import numpy as np

from retarget.hierarchy import JointLimits
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from retarget.stance import Stance

__all__ = ["following_limits"]

KNEE_BENT = 0.2
"""Bend (rad) that a knee keeps. A straight leg is singular: to move its hip on, the knee would have to turn at once."""
SAMPLES = 181
"""Angles at which a knee is tried."""


def following_limits(robot: RobotBody, stance: Stance) -> JointLimits:
    """Limits of every DoF (nv,). A free root has none; speeds are capped by the profile's share for following."""
    servos, body = robot.limits, robot.body
    dofs = [body.dof_index(joint) for joint in robot.joint_map.joints]
    columns = []
    for values, none in (
        (servos.lower, -np.inf),
        (servos.upper, np.inf),
        (servos.max_velocity * robot.profile.safety.speed_caps.follow, np.inf),
        (servos.max_acceleration, np.inf),
    ):
        whole = np.full(body.nv, none)
        whole[dofs] = values
        columns.append(whole)
    lower, upper, max_velocity, max_acceleration = columns
    for side in ("l", "r") if stance.soles else ():
        _keep_bent(robot, stance, side, lower, upper)
    return JointLimits(lower, upper, max_velocity, max_acceleration)


def _keep_bent(robot: RobotBody, stance: Stance, side: str, lower: FloatArray, upper: FloatArray) -> None:
    """Draw in the limit (nv,) of a knee on its straight side; nothing where the profile has no frames of the leg."""
    body, frames = robot.body, robot.profile.frames
    if not {f"{side}_hip", f"{side}_knee", f"{side}_ankle"} <= set(frames):
        return
    link = robot.frame(f"{side}_knee").body
    joints = np.flatnonzero(body.joint_body == link)
    if joints.size != 1:
        return
    dof, column = int(body.joint_dof[joints[0]]), int(body.joint_qpos[joints[0]])
    angles = np.linspace(lower[dof], upper[dof], SAMPLES)
    postures = np.tile(stance.q, (SAMPLES, 1))
    postures[:, column] = angles
    hip, ankle = np.moveaxis(robot.points(postures, (f"{side}_hip", f"{side}_ankle")), 1, 0)
    straight = float(angles[np.argmax(np.linalg.norm(hip - ankle, axis=1))])
    if stance.q[column] > straight:
        lower[dof] = max(lower[dof], min(straight + KNEE_BENT, float(stance.q[column])))
    else:
        upper[dof] = min(upper[dof], max(straight - KNEE_BENT, float(stance.q[column])))
