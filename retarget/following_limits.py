"""The limits within which a robot follows: those of its servos, and limbs that never get quite straight."""

import numpy as np

from retarget.followed_speed import followed_speed
from retarget.joint_limits import JointLimits
from retarget.loaded_speed import loaded_speed
from retarget.off_stops import off_stops
from retarget.priorities import UpholdSettings
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from retarget.stance import Stance

__all__ = ["following_limits"]

LIMBS = {"knee": ("hip", "ankle"), "elbow": ("shoulder", "hand")}
"""Middle joint of a limb, and the frames at its ends."""
BENT = 0.2
"""Bend (rad) that knees and elbows keep, towards where the standing robot bends them.

A straight limb is singular: a straight leg could not move its hip on without turning its knee at once, and an arm that
stretches for something out of reach would swing its elbow from one side to the other. It costs 0.5 % of the reach."""
SAMPLES = 181
"""Angles at which a joint is tried."""


def following_limits(robot: RobotBody, stance: Stance, uphold: UpholdSettings | None = None) -> JointLimits:
    """Limits of every DoF (nv,). A free root has none; speeds are capped by the profile's share for following. uphold:
    of a robot with mass, which keeps off its stops, and to speeds of loaded servos."""
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
    for middle, ends in LIMBS.items():
        for side in ("l", "r"):
            _keep_bent(robot, stance, [f"{side}_{part}" for part in (ends[0], middle, ends[1])], lower, upper)
    limits = JointLimits(lower, upper, max_velocity, max_acceleration)
    return limits if uphold is None else _upheld(robot, limits, uphold)


def _upheld(robot: RobotBody, limits: JointLimits, uphold: UpholdSettings) -> JointLimits:
    limits = loaded_speed(robot, limits, reserve=uphold.reserve)
    limits = followed_speed(robot, limits, late=uphold.late)
    return off_stops(robot, limits, margin=uphold.off_stops)


def _keep_bent(robot: RobotBody, stance: Stance, limb: list[str], lower: FloatArray, upper: FloatArray) -> None:
    """Draw in the limit (nv,) of a limb's middle joint on its straight side; not where the profile lacks its frames."""
    body = robot.body
    if not set(limb) <= set(robot.profile.frames):
        return
    start, middle, end = limb
    joints = np.flatnonzero(body.joint_body == robot.frame(middle).body)
    if joints.size != 1:
        return
    dof, column = int(body.joint_dof[joints[0]]), int(body.joint_qpos[joints[0]])
    angles = np.linspace(lower[dof], upper[dof], SAMPLES)
    postures = np.tile(stance.q, (SAMPLES, 1))
    postures[:, column] = angles
    near, far = np.moveaxis(robot.points(postures, (start, end)), 1, 0)
    straight = float(angles[np.argmax(np.linalg.norm(near - far, axis=1))])
    standing = float(stance.q[column])
    if standing > straight:
        lower[dof] = max(lower[dof], min(straight + BENT, standing))
    else:
        upper[dof] = min(upper[dof], max(straight - BENT, standing))
