"""The displacement box of one frame in plain NumPy: the oracle for `retarget._solver.Braking`."""

import numpy as np

from oracles.problem import Array


def braking_displacement(gap: Array, change: Array) -> Array:
    """Largest x with x + (x - change) + (x - 2 change) + ... (terms above 0) <= gap, element by element; `gap` itself
    where <= 0."""
    n = np.floor((np.sqrt(1.0 + 8.0 * np.maximum(gap, 0.0) / change) - 1.0) / 2.0)
    x: Array = (gap + change * n * (n + 1.0) / 2.0) / (n + 1.0)
    return np.where(gap > 0.0, x, gap)


def frame_bounds(
    q: Array,
    before: Array,
    lower: Array,
    upper: Array,
    max_velocity: Array,
    max_acceleration: Array,
    dt: float,
) -> tuple[Array, Array]:
    """(lo, hi), (n,) each: acceleration first, then velocity, then position and braking distance; always lo <= hi."""
    step, change = max_velocity * dt, max_acceleration * dt**2
    slowest, fastest = before - change, before + change
    hi = np.clip(np.clip(braking_displacement(upper - q, change), -step, step), slowest, fastest)
    lo = np.clip(np.clip(-braking_displacement(q - lower, change), -step, step), slowest, fastest)
    crossed = lo > hi
    still = np.clip(np.clip(0.0, slowest, fastest), np.minimum(lo, hi), np.maximum(lo, hi))
    return np.where(crossed, still, lo), np.where(crossed, still, hi)
