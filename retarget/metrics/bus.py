"""What the bus's own clock and the guard say of a run."""

import numpy as np

from retarget.rotations import FloatArray

__all__ = ["longest_period", "tick_rate"]


def tick_rate(times: FloatArray) -> float | None:
    """Ticks per second, of the times (T,) s at which servos were read; None where that was not measured."""
    known = times[np.isfinite(times)]
    lasted = float(known[-1] - known[0]) if known.size > 1 else 0.0
    return (known.size - 1) / lasted if lasted > 0.0 else None


def longest_period(times: FloatArray) -> float | None:
    """Longest time (s) from one tick to the next: a single stall shows here, where a long run hides it in the rate."""
    known = times[np.isfinite(times)]
    return float(np.diff(known).max()) if known.size > 1 else None
