"""Array types of the servo side (C-contiguous, one entry per servo, in the profile's servo order) and questions
about small arrays.
"""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
TickArray = NDArray[np.int64]
ByteArray = NDArray[np.uint8]
BoolArray = NDArray[np.bool_]


# Questions about small arrays, such as one value for each servo. The methods of an array take a microsecond more.


def all_of(which: BoolArray) -> bool:
    """Whether all are true."""
    return bool(np.count_nonzero(which) == which.size)


def any_of(which: BoolArray | ByteArray) -> bool:
    """Whether any is true, or not 0."""
    return bool(np.count_nonzero(which))
