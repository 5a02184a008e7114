"""Array types: C-contiguous, one entry per servo, in the profile's servo order."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
TickArray = NDArray[np.int64]
ByteArray = NDArray[np.uint8]
BoolArray = NDArray[np.bool_]
