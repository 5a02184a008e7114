"""What is thought of one sensor at one instant."""

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

__all__ = ["StateArray", "TrustState"]

StateArray = NDArray[np.uint8]
"""One TrustState per sensor, (k,)."""


class TrustState(IntEnum):
    """Only a FRESH sensor is believed."""

    FRESH = 0
    """Its last accepted pose is recent, and nothing speaks against it."""
    STALE = 1
    """Nothing of it was accepted for too long: lost, or not heard yet."""
    FROZEN = 2
    """It repeats one value to the bit while others move: the sender has lost it and does not say so."""
    JUMPED = 3
    """It went farther than a human can, and stays there."""
    SWAPPED = 4
    """It and its other side have exchanged places at once."""
    NOT_WORN = 5
    """It was not heard since the start."""
    OUT_OF_RANGE = 6
    """It is told to be outside the room."""
