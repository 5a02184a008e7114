"""Looks for the posture in which two shapes are nearest, or farthest: a pattern search over the joints between them."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from retarget.body import BodyModel
from retarget.fitting.ranges import JointRanges
from retarget.fitting.shape_model import Pair, ShapeModel
from retarget.rotations import FloatArray

__all__ = ["descend", "dofs_between"]

FIRST_STEP = 0.25
LAST_STEP = 1e-3
"""Steps of the search, as shares of each joint's range."""
RANDOM_STEPS = 4
MAX_LOOKS = 1500


def dofs_between(body: BodyModel, first: int, second: int) -> NDArray[np.int64]:
    """Degrees of freedom that move one link against the other."""
    moving = body.links_between(first, second)
    ends = np.append(body.joint_dof[1:], body.nv)
    found = [
        dof
        for joint, link in enumerate(body.joint_body)
        if int(link) in moving
        for dof in range(int(body.joint_dof[joint]), int(ends[joint]))
    ]
    return np.array(found, dtype=np.int64)


def descend(
    model: ShapeModel,
    ranges: JointRanges,
    pair: Pair,
    q: FloatArray,
    *,
    dofs: NDArray[np.int64],
    sign: float,
    enough: float,
    rng: np.random.Generator,
) -> float:
    """A local minimum, m, of sign * distance, from the posture q (nq,).

    Stops early below `enough`. Every joint is tried by itself, and all in random directions; steps shrink when none
    helps.
    """
    spans = np.full(model.nv, np.pi)
    spans[ranges.dofs] = ranges.upper - ranges.lower

    def value(q: FloatArray) -> float:
        model.place(q)
        return sign * model.distance(pair)

    best, step, looks = value(q), FIRST_STEP, 1
    while step > LAST_STEP and best > enough and looks < MAX_LOOKS:
        found, after, tried = _poll(model, ranges, value, best, q, _steps(dofs, spans * step, rng))
        looks += tried
        if found < best - 1e-9:
            best, q = found, after
        else:
            step /= 2.0
    return best


def _steps(dofs: NDArray[np.int64], spans: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Steps (k, nv) to try: each degree of freedom to both sides, and some random directions."""
    alone = np.zeros((len(dofs), len(spans)))
    alone[np.arange(len(dofs)), dofs] = spans[dofs]
    together = np.zeros((RANDOM_STEPS, len(spans)))
    together[:, dofs] = rng.uniform(-1.0, 1.0, size=(RANDOM_STEPS, len(dofs))) * spans[dofs]
    return np.concatenate([alone, -alone, together])


def _poll(
    model: ShapeModel,
    ranges: JointRanges,
    value: Callable[[FloatArray], float],
    best: float,
    q: FloatArray,
    steps: FloatArray,
) -> tuple[float, FloatArray, int]:
    """Try steps one after the other, each from the best so far: value, posture and number of looks."""
    for step in steps:
        after = ranges.clipped(model.moved(q, step))
        found = value(after)
        if found < best:
            best, q = found, after
    return best, q, len(steps)
