"""Tracks of points, small enough to travel inside a page: 16 bits a number, as text."""

import base64
from dataclasses import dataclass

import numpy as np

from retarget.rotations import FloatArray

__all__ = ["UNKNOWN", "Packed", "packed"]

UNKNOWN = -32768
"""Stands for NaN."""
MOST = 32767
FINEST = 1e-4
"""m to a unit at least: 3.3 m are told to a tenth of a millimetre."""


@dataclass(frozen=True)
class Packed:
    """data: base64 of little-endian 16-bit integers. unit: m to one of them."""

    data: str
    unit: float


def packed(values: FloatArray) -> Packed:
    """Any array of lengths, m; NaN stays not known."""
    largest = float(np.nanmax(np.abs(values), initial=0.0)) if np.isfinite(values).any() else 0.0
    unit = max(FINEST, largest / MOST)
    with np.errstate(invalid="ignore"):
        whole = np.where(np.isfinite(values), np.rint(values / unit), UNKNOWN)
    return Packed(base64.b64encode(whole.astype("<i2").tobytes()).decode("ascii"), unit)
