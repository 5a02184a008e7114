"""Poses as Unity's wire formats have them (VMC, VRChat OSC) into the world's axes.

Which axes those are stands in `stream_axes`; here are the order of the numbers and Unity's Euler angles.
"""

import numpy as np
from numpy.typing import ArrayLike

from retarget.rotations import FloatArray
from retarget.sources.stream_axes import CONVENTIONS

__all__ = ["euler_from_unity", "poses_from_unity", "position_from_unity"]

_UNITY = CONVENTIONS["unity"]
_WXYZ = np.array([3, 0, 1, 2])
_POSE = np.zeros((7, 7))
_POSE[:3, :3] = _UNITY.positions(np.eye(3))
_POSE[3:, 3:] = _UNITY.orientations(np.eye(4)[:, _WXYZ])
"""A row of seven numbers times this is the pose; every entry is 0, 1 or -1, so that nothing is rounded."""
_HALF_DEGREE = np.pi / 360.0


def position_from_unity(position: ArrayLike) -> FloatArray:
    """Positions (..., 3) m of Unity, in the world's axes."""
    return _UNITY.positions(position)


def poses_from_unity(poses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Position (..., 3) and quaternion wxyz (..., 4) of Unity's x, y, z, qx, qy, qz, qw (..., 7), in one go.

    A pose with one number that is not finite is NaN throughout.
    """
    turned = poses @ _POSE
    return turned[..., :3], turned[..., 3:]


def euler_from_unity(degrees: ArrayLike) -> FloatArray:
    """Quaternions wxyz (..., 4), world's axes, of Unity's Euler angles x, y, z (..., 3) in degrees.

    Unity turns by z, then x, then y, about fixed axes: q = q_y q_x q_z (docs.unity3d.com, Quaternion.Euler).
    """
    half = np.asarray(degrees, float) * _HALF_DEGREE
    c, s = np.cos(half), np.sin(half)
    cx, cy, cz = c[..., 0], c[..., 1], c[..., 2]
    sx, sy, sz = s[..., 0], s[..., 1], s[..., 2]
    out = np.empty((*half.shape[:-1], 4))
    out[..., 0] = cy * cx * cz + sy * sx * sz
    out[..., 1] = cy * sx * cz + sy * cx * sz
    out[..., 2] = sy * cx * cz - cy * sx * sz
    out[..., 3] = cy * cx * sz - sy * sx * cz
    return _UNITY.orientations(out)
