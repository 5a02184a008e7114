"""Is x lexicographically optimal? Multipliers with the right signs must exist at every level (KKT).

Level k is optimal on the set that the levels above left when its gradient `C^T (C x - e) + D^T violation` combines
* rows that this set fixes (equality rows above, violated rows above, fixed columns): any sign;
* rows and box bounds met with equality, violated nowhere: the sign that pushes back inside.
Multipliers need not be unique, so they are searched for by non-negative least squares instead of being computed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from oracles.problem import Array, Hierarchy, Level

ACTIVE = 1e-9  # relative distance within which a bound counts as met


@dataclass(frozen=True)
class Multipliers:
    """Non-negative multipliers of the signed rows, and what of the gradient no multipliers explain."""

    signed: Array
    residual: Array


def find_multipliers(gradient: Array, free: Array, signed: Array) -> Multipliers:
    """Best `gradient = free^T a + signed^T b`, b >= 0; rows of `free` (f, n) and `signed` (s, n) may be dependent."""
    basis = row_basis(free)
    rest = gradient - basis.T @ (basis @ gradient)
    if len(signed) == 0:
        return Multipliers(np.zeros(0), rest)
    rows = signed - (signed @ basis.T) @ basis
    rows = rows - (rows @ basis.T) @ basis
    length = np.linalg.norm(rows, axis=1)
    # What is left of a row that the fixed rows already imply is rounding: it may not explain anything.
    alive = length > 1e-9 * np.linalg.norm(signed, axis=1)
    scale = float(np.linalg.norm(rest))
    found = np.zeros(len(signed))
    if scale > 0.0 and alive.any():
        unit = rows[alive] / length[alive, None]
        solution, _ = nnls(unit.T, rest / scale, maxiter=50 * (unit.shape[0] + unit.shape[1]))
        found[alive] = scale * solution / length[alive]
    return Multipliers(found, rest - rows.T @ found)


def row_basis(rows: Array, tolerance: float = 1e-10) -> Array:
    """Orthonormal basis (r, n) of the row space; every row counts by its direction, not its length."""
    length = np.linalg.norm(rows, axis=1)
    unit = rows[length > 0.0] / length[length > 0.0, None]
    if len(unit) == 0:
        return np.zeros((0, rows.shape[1]))
    _, values, right = np.linalg.svd(unit, full_matrices=False)
    return np.asarray(right[values > tolerance * values[0]])


def signed_rows(level: Level, x: Array) -> tuple[Array, Array]:
    """Inequality rows of a level at x: violated (f, n), and met, signed so that a multiplier is >= 0 (s, n)."""
    value = level.D @ x
    reach = ACTIVE * (1.0 + np.linalg.norm(level.D, axis=1) * np.linalg.norm(x))
    broken = np.abs(level.violation(x)) > reach
    low = ~broken & (np.abs(value - level.lower) <= reach)
    high = ~broken & (np.abs(value - level.upper) <= reach)
    return level.D[broken | (low & high)], np.vstack([level.D[low & ~high], -level.D[high & ~low]])


def box_rows(problem: Hierarchy, x: Array) -> tuple[Array, Array]:
    """Unit rows of the fixed columns (f, n), and of the box bounds met at x, signed (s, n)."""
    identity = np.eye(problem.nv)
    low = x - problem.lo <= ACTIVE * (1.0 + np.abs(problem.lo))
    high = problem.hi - x <= ACTIVE * (1.0 + np.abs(problem.hi))
    return identity[low & high], np.vstack([identity[low & ~high], -identity[high & ~low]])


def gradient_of(level: Level, x: Array) -> Array:
    """Gradient (n,) of half the squared slack of a level at x."""
    return level.C.T @ (level.C @ x - level.e) + level.D.T @ level.violation(x)


def gradient_scale(level: Level, x: Array, box: float) -> float:
    """Size of the terms that cancel in the gradient: what its error is measured against. `box`: length of the box."""
    rows = float(np.sqrt(np.sum(level.C**2) + np.sum(level.D**2)))
    reach = float(np.linalg.norm(x)) + 1e-3 * box
    return rows * (level.size(x) + rows * reach) + np.finfo(float).tiny


def optimality(problem: Hierarchy, x: Array) -> Array:
    """Unexplained part of every level's gradient at x, relative (p + 1,), the tie-break last; 0 when x is optimal."""
    box = float(np.linalg.norm(problem.hi - problem.lo))
    free, signed = box_rows(problem, x)
    worst = []
    for level in problem.all_levels:
        residual = find_multipliers(gradient_of(level, x), free, signed).residual
        worst.append(float(np.linalg.norm(residual)) / gradient_scale(level, x, box))
        broken, met = signed_rows(level, x)
        free = np.vstack([free, level.C, broken])
        signed = np.vstack([signed, met])
    return np.array(worst)


def outside_box(problem: Hierarchy, x: Array) -> float:
    """How far x lies outside the box; exactly 0 when inside."""
    return float(max(np.max(problem.lo - x, initial=0.0), np.max(x - problem.hi, initial=0.0)))
