"""Arcs between orientations of many sensors, quickly: what a tick can afford, for unit quaternions only.

The same as `rotations.slerp` and `rotations.log` at a third of their time: few operations on whole arrays.
"""

import numpy as np

from retarget.rotations import FloatArray

__all__ = ["FOUR", "along_arc", "turn_between"]

SAME_ANGLE = 1e-8
"""An arc shorter than this (rad, of quaternions) is taken as one of this length: the weights have their limits."""
FOUR = np.ones(4)
"""(values * values).dot(FOUR) is the quickest sum over rows of four."""
_THREE = np.ones(3)
FOUR.flags.writeable = _THREE.flags.writeable = False


def along_arc(a: FloatArray, b: FloatArray, share: FloatArray) -> FloatArray:
    """Orientations (k, 4) wxyz on the short arc from a through b, at a share (k) of the way, which may exceed 1."""
    cosine = (a * b).dot(FOUR)
    sign = np.copysign(1.0, cosine)
    angle = np.maximum(np.arccos(np.minimum(cosine * sign, 1.0)), SAME_ANGLE)
    scale = 1.0 / np.sin(angle)
    along = share * angle
    weight_a, weight_b = scale * np.sin(angle - along), scale * sign * np.sin(along)
    return np.asarray(weight_a[:, None] * a + weight_b[:, None] * b)


def turn_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Rotation vectors (k, 3) in rad, seen from the world, that turn a (k, 4) into b (k, 4) the short way."""
    parts = (b[:, :, None] * a[:, None, :]).reshape(len(a), 16)
    vector = parts.dot(_VECTOR_OF_B_A_INVERSE)
    cosine = (a * b).dot(FOUR)
    sine = np.sqrt((vector * vector).dot(_THREE))
    # sin(x)/x is 1 to double precision at 1e-9.
    scale = 2.0 * np.arctan2(sine + 1e-300, np.abs(cosine)) / (sine + 1e-300)
    return np.asarray((scale * np.copysign(1.0, cosine))[:, None] * vector)


def _vector_of_product_with_inverse() -> FloatArray:
    """(16, 3): takes the products b_i a_j (16) to the vector part of b a^-1, a unit quaternion."""
    table = np.zeros((4, 4, 3))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        # b_v a_w - b_w a_v - b_v x a_v
        table[1 + i, 0, i], table[0, 1 + i, i] = 1.0, -1.0
        table[1 + j, 1 + k, i], table[1 + k, 1 + j, i] = -1.0, 1.0
    return table.reshape(16, 3)


_VECTOR_OF_B_A_INVERSE = _vector_of_product_with_inverse()
