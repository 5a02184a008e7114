"""Poses of a single obstacle at a single instant, resting or moving, and how they are chained."""

from dataclasses import dataclass
from math import sqrt

from retarget.scalar_rotations import Quat, Vector, plus, product, rotated

__all__ = ["HERE", "STILL", "MovingPose", "Pose", "carried_by", "cross", "on_body", "unit"]

STILL: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Pose:
    """A frame in its parent: position m, unit quaternion wxyz."""

    position: Vector = (0.0, 0.0, 0.0)
    quat: Quat = (1.0, 0.0, 0.0, 0.0)

    def inside(self, child: "Pose") -> "Pose":
        """Where a pose given in this frame is in the parent: T_parent_this T_this_child."""
        return Pose(plus(self.position, rotated(self.quat, child.position)), product(self.quat, child.quat))


HERE = Pose()
"""The parent's own frame."""


@dataclass(frozen=True, slots=True)
class MovingPose:
    """A pose and how it moves: velocity of its origin, m/s, and angular velocity, rad/s, along the parent's axes."""

    pose: Pose
    linear: Vector = STILL
    angular: Vector = STILL


def carried_by(parent: Pose, moving: MovingPose) -> MovingPose:
    """What moves in a frame that rests, seen from that frame's own parent."""
    return MovingPose(
        parent.inside(moving.pose), rotated(parent.quat, moving.linear), rotated(parent.quat, moving.angular)
    )


def on_body(moving: MovingPose, child: Pose) -> MovingPose:
    """A pose that is fixed to what moves: v_child = v + w x r, the same w."""
    arm = rotated(moving.pose.quat, child.position)
    return MovingPose(moving.pose.inside(child), plus(moving.linear, cross(moving.angular, arm)), moving.angular)


def cross(a: Vector, b: Vector) -> Vector:
    """The vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def unit(quat: Quat) -> Quat:
    """The quaternion (not zero) at length 1."""
    w, x, y, z = quat
    norm = sqrt(w * w + x * x + y * y + z * z)
    return (w / norm, x / norm, y / norm, z / norm)
