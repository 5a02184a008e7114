"""What a pose from outside must keep to before anything is computed from it."""

import numpy as np

from retarget.frames import BoolArray
from retarget.rotations import FloatArray

__all__ = ["MAX_COORDINATE", "NORM_TOLERANCE", "unusable"]

MAX_COORDINATE = 1e6
"""Larger coordinates, in any unit from millimetres up, are no place in a room."""
NORM_TOLERANCE = 0.02
"""A quaternion whose norm is farther from 1 is no rounded rotation but something else."""

_LOW, _HIGH = (1.0 - NORM_TOLERANCE) ** 2, (1.0 + NORM_TOLERANCE) ** 2


def unusable(position: FloatArray, orientation: FloatArray) -> BoolArray:
    """Which of k poses, position (k, 3) and orientation (k, 4), are not finite, not in a room, or no rotation.

    Values must not exceed float32's, so that squares stay finite.
    """
    square = np.einsum("ij,ij->i", orientation, orientation)
    # Comparisons with NaN are False, so the question is what is good.
    good = np.all(np.abs(position) <= MAX_COORDINATE, axis=1) & (square >= _LOW) & (square <= _HIGH)
    return np.asarray(~good)
