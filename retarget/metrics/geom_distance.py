"""MuJoCo's distance between two geoms of a model, wherever they are put."""

from itertools import pairwise
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
    measure, first, second = mujoco.mj_geomDistance, pairs[:, 0], pairs[:, 1]
    at, turned = data.geom_xpos, data.geom_xmat
    places: IntArray | slice = geoms
    if np.array_equal(geoms, np.arange(len(geoms))):  # the usual case: a slice is written faster than single rows
        at, turned, places = at[: len(geoms)], turned[: len(geoms)], slice(None)

    def distances(rows: IntArray, which: IntArray) -> FloatArray:
        found: list[float] = []
        a, b = first[which].tolist(), second[which].tolist()
        begins = [0, *(np.flatnonzero(np.diff(rows)) + 1).tolist(), len(rows)]
        for begin, end in pairwise(begins):
            if begin < end:
                at[places], turned[places] = position[rows[begin]], matrix[rows[begin]]
                found += [
                    measure(model, data, i, j, FAR_M, None) for i, j in zip(a[begin:end], b[begin:end], strict=True)
                ]
        return np.array(found, dtype=float)

    return distances
