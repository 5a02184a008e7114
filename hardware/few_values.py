"""Questions about few values, a robot's servos say: quicker than the methods of an array, which take a microsecond."""

import numpy as np

from hardware.arrays import BoolArray, ByteArray

__all__ = ["all_of", "any_of"]


def all_of(which: BoolArray) -> bool:
    """Whether all are true."""
    return bool(np.count_nonzero(which) == which.size)


def any_of(which: BoolArray | ByteArray) -> bool:
    """Whether any is true, or not 0."""
    return bool(np.count_nonzero(which))
