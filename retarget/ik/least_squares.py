"""Nonlinear least squares in a box: Levenberg-Marquardt (Nocedal and Wright, 2006, section 10.3).

A library's solver on BLAS would not give the same bits on every machine, and the results decide goals.
"""

from collections.abc import Callable
from math import fsum, sqrt

import numpy as np

from retarget._solver import solve_hierarchy
from retarget.arithmetic import matmul, norm
from retarget.types import FloatArray

DIFFERENCE = 1.5e-8
"""Step of a forward difference, as a share of 1 or of a larger unknown: the root of the rounding error."""
FIRST_DAMPING = 1e-3
"""Damping of the first step, as a share of the largest squared column of the Jacobian (Nielsen, 1999)."""

LEAST_DAMPING = 1e-12  # where no unknown changes anything


def least_squares(
    residual: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    *,
    lower: FloatArray | None = None,
    upper: FloatArray | None = None,
    close: float = 1e-8,
    most_steps: int = 100,
) -> FloatArray:
    """The unknowns (n,) near `start` (n,) that minimise the sum of squares of residual(unknowns) (m,).

    lower, upper (n,): the box. close: the search ends with a shorter step, as a share of 1 or of the unknowns.
    """
    low = np.full(len(start), -np.inf) if lower is None else lower
    high = np.full(len(start), np.inf) if upper is None else upper
    x = np.clip(start, low, high)
    off = residual(x)
    jacobian = _jacobian(residual, x, off, high)
    damping, harder = max(FIRST_DAMPING * float(np.square(jacobian).sum(axis=0).max()), LEAST_DAMPING), 2.0
    for _ in range(most_steps):
        there = np.clip(x + _damped_step(jacobian, off, damping, low - x, high - x), low, high)
        step = there - x
        if norm(step) <= close * (1.0 + norm(x)):
            break
        tried = residual(there)
        expected = _half_square(off) - _half_square(off + matmul(jacobian, step))
        gain = (_half_square(off) - _half_square(tried)) / max(expected, 1e-300)
        if gain > 0.0:
            x, off = there, tried
            jacobian = _jacobian(residual, x, off, high)
            bend = 2.0 * gain - 1.0
            damping, harder = damping * max(1.0 / 3.0, 1.0 - bend * bend * bend), 2.0
        else:
            damping, harder = damping * harder, 2.0 * harder
    return x


def _half_square(off: FloatArray) -> float:
    return 0.5 * fsum((off * off).tolist())


def _jacobian(
    residual: Callable[[FloatArray], FloatArray], x: FloatArray, off: FloatArray, high: FloatArray
) -> FloatArray:
    """(m, n) by forward differences, or backward ones where the box ends."""
    columns = []
    for k, value in enumerate(x.tolist()):
        moved, step = x.copy(), DIFFERENCE * max(1.0, abs(value))
        moved[k] = value + step if value + step <= high[k] else value - step
        columns.append((residual(moved) - off) / (moved[k] - value))
    return np.ascontiguousarray(np.stack(columns, axis=1))


def _damped_step(
    jacobian: FloatArray, off: FloatArray, damping: float, low: FloatArray, high: FloatArray
) -> FloatArray:
    """The step (n,) within low and high that minimises |jacobian step + off|^2 + damping |step|^2."""
    still = np.zeros(len(low))
    step, _, _ = solve_hierarchy(
        jacobian, -off, -off, [len(off)], lo=low, hi=high, still=still, damping=0.0, least_damping=sqrt(damping)
    )
    return step
