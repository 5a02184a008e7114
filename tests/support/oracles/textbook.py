"""The strict hierarchy as the literature writes it, on equality rows only: projectors and pseudo-inverses.

Siciliano and Slotine 1991, with the recursive projector of Baerlocher and Boulic 2004.
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
