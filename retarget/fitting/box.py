"""A small box around a link's geometry: the best of the orientations that the geometry itself suggests."""

from dataclasses import dataclass

import numpy as np

from retarget.fitting.geometry import LinkGeometry
from retarget.rotations import FloatArray, from_matrix

__all__ = ["Box", "enclosing_box"]

MIN_HALF = 1e-4
"""[m] flat geometry gets this half size."""


@dataclass(frozen=True, eq=False)
class Box:
    """pos (3,) m and quat (4,) wxyz in the link's frame, half sizes (3,) m."""

    pos: FloatArray
    quat: FloatArray
    size: FloatArray

    @property
    def volume(self) -> float:
        """m^3."""
        return float(8.0 * np.prod(self.size))


def enclosing_box(geometry: LinkGeometry) -> Box:
    """The smallest box along the link's own axes, its geoms' or the principal ones; in doubt the earlier of these."""
    centres = geometry.centres
    principal = np.linalg.svd(centres - centres.mean(axis=0), full_matrices=True)[2].T
    best: Box | None = None
    for turn in (np.eye(3), *geometry.axes, principal):
        box = _along(turn if np.linalg.det(turn) > 0.0 else turn * [1.0, 1.0, -1.0], geometry)
        if best is None or box.volume < best.volume * (1.0 - 1e-6):
            best = box
    assert best is not None
    return best


def _along(turn: FloatArray, geometry: LinkGeometry) -> Box:
    local, radii = geometry.centres @ turn, geometry.radii[:, None]
    low, high = (local - radii).min(axis=0), (local + radii).max(axis=0)
    size = np.maximum((high - low) / 2.0, MIN_HALF)
    return Box(turn @ ((low + high) / 2.0), from_matrix(turn), size)
