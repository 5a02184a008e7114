"""The damped hierarchy as a cascade of quadratic programs, written as the maths says it; solved by daqp.

Stage k, in z = weight (x - ref) with z0 standing still (x = 0): min |slack|^2 + mu^2 |z - z0|^2, where the targets of
the levels above stay as reached, limits that were met hold, and limits that were missed are missed by no more. Limits
alone have hardly any damping, and go as far as targets would, at most. The last stage stays the nearer to standing
still, the more is missed.
"""

from __future__ import annotations

import math

import daqp
import numpy as np

from oracles.problem import Array, Hierarchy

LEAST_DAMPING, LEAST_OF_LIMITS, YIELDING = 1e-3, 1e-4, 200.0
"""As of `hierarchy/stages.rs`."""
MET = 1e-11
EQUALITY = 5
"""daqp's sense of a row that always holds."""


def solve_damped(problem: Hierarchy, damping: float) -> Array:
    """The answer (nv,). damping: mu^2 for each unit of a level's error, beside its least."""
    nv, weight = problem.nv, problem.weight
    lo, hi = (problem.lo - problem.ref) * weight, (problem.hi - problem.ref) * weight
    z0 = -problem.ref * weight
    z = np.clip(z0, lo, hi)
    rows, lower, upper = np.eye(nv), lo, hi
    unmet = 0.0
    for level in problem.levels:
        both, (first, last) = np.vstack([level.C, level.D]), level.limits
        target, shift = first == last, both @ problem.ref
        C, D, e = both[target] / weight, both[~target] / weight, (first - shift)[target]
        low, high = (first - shift)[~target], (last - shift)[~target]
        beyond = np.maximum(low - D @ z, 0.0) + np.maximum(D @ z - high, 0.0)
        missing = np.sqrt(np.sum((e - C @ z) ** 2) + np.sum(beyond[beyond > MET] ** 2))
        if missing > MET:
            error = max(float(np.linalg.norm(e - C @ z0)), float(missing))
            mu2 = damping * error + LEAST_DAMPING**2 if len(e) else LEAST_OF_LIMITS**2
            before, reach = z, 0.5 * math.sqrt(error / damping) if damping and not len(e) else math.inf
            k = len(low)
            H = np.zeros((nv + k, nv + k))
            H[:nv, :nv], H[nv:, nv:] = C.T @ C + mu2 * np.eye(nv), np.eye(k)
            f = np.concatenate([-C.T @ e - mu2 * z0, np.zeros(k)])
            A = np.vstack([np.hstack([rows, np.zeros((len(rows), k))]), np.hstack([D, np.eye(k)])])
            z = program(H, f, A, np.concatenate([lower, low]), np.concatenate([upper, high]))[:nv]
            z = before + (z - before) * float(np.minimum(1.0, reach / max(float(np.linalg.norm(z - before)), 1e-300)))
            unmet = max(unmet, float(np.linalg.norm(e - C @ z)))
        rows = np.vstack([rows, C, D])
        lower = np.concatenate([lower, C @ z, np.minimum(low, D @ z)])
        upper = np.concatenate([upper, C @ z, np.maximum(high, D @ z)])
    yields = YIELDING * damping * unmet
    near = yields / (1.0 + yields) * z0
    if problem.soft is None:
        z = program(np.eye(nv), -near, rows, lower, upper)
    else:
        S, s = problem.soft[0] / weight, problem.soft[1] - problem.soft[0] @ problem.ref
        z = program(np.eye(nv) + S.T @ S, -near - S.T @ s, rows, lower, upper)
    return np.asarray(np.clip(problem.ref + z / weight, problem.lo, problem.hi))


def program(H: Array, f: Array, A: Array, lower: Array, upper: Array) -> Array:
    """min 0.5 x H x + f x, lower <= A x <= upper; rows that depend on targets are left out."""
    low, high = np.maximum(lower, -1e30), np.minimum(upper, 1e30)
    same = high - low < 1e-12
    kept = np.ones(len(A), dtype=bool)
    basis = np.zeros((0, A.shape[1]))
    for row in np.flatnonzero(same):
        left = A[row] - basis.T @ (basis @ A[row])
        left -= basis.T @ (basis @ left)
        if np.linalg.norm(left) <= 1e-8 * max(float(np.linalg.norm(A[row])), 1e-12):
            kept[row] = False
        else:
            basis = np.vstack([basis, left / np.linalg.norm(left)])
    sense = np.where(same, EQUALITY, 0).astype(np.int32)[kept]
    length = np.maximum(np.linalg.norm(A[kept], axis=1), 1e-12)  # daqp's tolerance counts in units of the rows
    A, low, high = np.ascontiguousarray(A[kept] / length[:, None]), low[kept] / length, high[kept] / length
    x, _, flag, _ = daqp.solve(H, f, A, high, low, sense, primal_tol=1e-10, dual_tol=1e-12, eps_prox=0.0)
    if flag < 1:
        raise ValueError(f"daqp gave up with flag {flag}")
    return np.asarray(x)
