"""The strict hierarchy as the literature writes it, on equality rows only: projectors and pseudo-inverses.

Siciliano and Slotine 1991, with the recursive projector of Baerlocher and Boulic 2004; and the clamping loop of the
paper's Figure 2, which only ever adds clamped joints and is therefore not optimal: compare with it, never trust it.
"""

from __future__ import annotations

import numpy as np

from oracles.problem import Array

EqualityLevel = tuple[Array, Array]
RANK = 1e-9  # relative singular value below which a direction is given up


def prioritized_pseudo_inverse(levels: list[EqualityLevel], weight: Array, ref: Array) -> Array:
    """Solve `C_k x = e_k` level by level; what is left follows `ref` (n,) in the metric of `weight` (n,) > 0."""
    # With y = w (x - ref) the weighted tie-break is the least-norm solution that a pseudo-inverse gives.
    y = np.zeros_like(ref)
    P = np.eye(len(ref))
    for C, e in levels:
        J = C / weight
        J_P = J @ P
        pinv = pseudo_inverse(J_P, J)
        y = y + pinv @ (e - C @ ref - J @ y)
        P = P - pinv @ J_P
    return ref + y / weight


def pseudo_inverse(J_P: Array, J: Array) -> Array:
    """Pseudo-inverse (n, m) of a projected Jacobian; the rank is judged against the Jacobian before projection."""
    left, values, right = np.linalg.svd(J_P, full_matrices=False)
    largest = np.linalg.norm(J, 2) if J.size else 0.0
    kept = values > RANK * largest
    return np.asarray((right[kept].T / values[kept]) @ left[:, kept].T)


def clamping_loop(levels: list[EqualityLevel], weight: Array, ref: Array, lo: Array, hi: Array) -> tuple[Array, int]:
    """Solve, clamp every joint that left its limits, solve in what is left (Figure 2); x (n,) and the solves made."""
    x = np.clip(ref, lo, hi)
    free = np.ones(len(ref), dtype=bool)
    solves = 0
    while free.any():
        reduced = [(C[:, free], e - C[:, ~free] @ x[~free]) for C, e in levels]
        x[free] = prioritized_pseudo_inverse(reduced, weight[free], ref[free])
        solves += 1
        beyond = free & ((x < lo) | (x > hi))
        if not beyond.any():
            break
        x = np.where(beyond, np.clip(x, lo, hi), x)
        free &= ~beyond
    return x, solves
