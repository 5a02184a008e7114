"""Inverse kinematics of a leg in closed form: hip with yaw, roll and pitch axes through one point, knee, ankle with
pitch and roll axes through one point (S. Kajita et al., Introduction to Humanoid Robotics, section 2.5).

Angles are rad about x forward, y left, z up of the trunk at the zero posture, where the leg is straight; a profile's
sense of each joint is a sign.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np

from retarget.arithmetic import arccos, arcsin, arctan2, cos, matmul, sin
from retarget.model.robot import RobotBody
from retarget.types import FloatArray

CHAIN = ("hip_yaw", "hip_roll", "hip_pitch", "knee", "ank_pitch", "ank_roll")
STRAIGHTEST = 0.9995
"""Largest share of its length that a leg is asked to span."""


@dataclass(frozen=True, eq=False)
class Leg:
    """hip (3,): where its three axes meet, in the trunk's frame, m. thigh, shank: lengths, m. sole (3,): centre of the
    sole from where the ankle's axes meet, m. signs (6,): of the joints of `CHAIN`."""

    hip: FloatArray
    thigh: float
    shank: float
    sole: FloatArray
    signs: FloatArray


def leg_of(robot: RobotBody, side: str) -> Leg:
    """The leg of a robot on `side`, "l" or "r", from its body at the zero posture."""
    body = robot.body
    q = robot.posture({})
    hip, knee, ankle, sole = robot.points(
        q[None], tuple(f"{side}_{name}" for name in ("hip", "knee", "ankle", "sole"))
    )[0]
    root = q[:3]
    axes = np.array([body.joint_axis[body.joint_index(f"{side}_{joint}")] for joint in CHAIN])
    hip[0] = knee[0]  # the profile's frame is where the leg's yaw axis is; OP3's other axes meet 0.1 mm before it
    return Leg(hip - root, float(hip[2] - knee[2]), float(knee[2] - ankle[2]), sole - ankle, axes.sum(axis=1))


def turn_x(angle: float) -> FloatArray:
    """Rotation matrix (3, 3) about x."""
    c, s = cos(angle), sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def turn_y(angle: float) -> FloatArray:
    """Rotation matrix (3, 3) about y."""
    c, s = cos(angle), sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def turn_z(angle: float) -> FloatArray:
    """Rotation matrix (3, 3) about z."""
    c, s = cos(angle), sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def leg_angles(leg: Leg, trunk: FloatArray, place: FloatArray, sole: FloatArray, at: FloatArray) -> FloatArray:
    """Joint angles (6,) rad, order `CHAIN`. trunk (3, 3), place (3,) m: pose of the trunk; sole (3, 3), at (3,) m: of
    the sole. A leg that would have to be longer than it is is as good as straight."""
    # The hip seen from the ankle, along the axes of the sole.
    ankle = at - matmul(sole, leg.sole)
    x, y, z = matmul(sole.T, place + matmul(trunk, leg.hip) - ankle).tolist()
    length = min(sqrt(x * x + y * y + z * z), STRAIGHTEST * (leg.thigh + leg.shank))
    cosine = (length * length - leg.thigh**2 - leg.shank**2) / (2.0 * leg.thigh * leg.shank)
    knee = arccos(min(max(cosine, -1.0), 1.0))
    lean = arcsin(min(leg.thigh * sin(knee) / length, 1.0))
    ankle_roll = arctan2(y, z)
    ankle_pitch = -arctan2(x, sqrt(y * y + z * z)) - lean
    # What is left for the hip: R_z(yaw) R_x(roll) R_y(pitch).
    rest = matmul(matmul(trunk.T, sole), matmul(turn_x(-ankle_roll), turn_y(-ankle_pitch - knee)))
    yaw = arctan2(-float(rest[0, 1]), float(rest[1, 1]))
    roll = arcsin(min(max(float(rest[2, 1]), -1.0), 1.0))
    pitch = arctan2(-float(rest[2, 0]), float(rest[2, 2]))
    return np.asarray(leg.signs * np.array([yaw, roll, pitch, knee, ankle_pitch, ankle_roll]))
