"""MuJoCo's distance between two geoms of a model, wherever they are put."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.metrics.closest_pairs import Distances
from retarget.rotations import FloatArray

__all__ = ["geom_distances"]

IntArray = NDArray[np.int64]
FAR_M = 1e4
"""Distances are known up to this, m."""


def geom_distances(
    model: Any, pairs: IntArray, *, geoms: IntArray, position: FloatArray, matrix: FloatArray
) -> Distances:
    """Signed distances (m,) m of rows of `pairs` (P, 2), numbers of geoms, in postures (m,) that come in rising order.

    geoms (g,): which are put where; position (T, g, 3) m and matrix (T, g, 9), world, in T postures.
    """
    import mujoco

    data = mujoco.MjData(model)
    measure, sides = mujoco.mj_geomDistance, pairs.tolist()
    at, turned = data.geom_xpos, data.geom_xmat

    def distances(rows: IntArray, which: IntArray) -> FloatArray:
        found, before = np.empty(len(rows)), -1
        for k, (row, pair) in enumerate(zip(rows.tolist(), which.tolist(), strict=True)):
            if row != before:
                at[geoms], turned[geoms] = position[row], matrix[row]
                before = row
            first, second = sides[pair]
            found[k] = measure(model, data, first, second, FAR_M, None)
        return found

    return distances
