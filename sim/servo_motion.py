"""How a servo's shaft follows its goal: the lag of its loop, with a drive that saturates at the no-load speed."""

import numpy as np

from hardware.arrays import FloatArray

__all__ = ["saturated_lag"]


def saturated_lag(
    error: FloatArray, *, lag: FloatArray, top: FloatArray, elapsed: float
) -> tuple[FloatArray, FloatArray]:
    """Displacement and final velocity (n,) after `elapsed` s of d/dt x = clip((goal - x) / lag, -top, top), `error` =
    goal - x at start.

    At top speed while the error exceeds `top * lag`, exponential after; `lag` 0 is a servo that runs at top speed to
    its goal.
    """
    distance = np.abs(error)
    knee = top * lag  # below this error the loop no longer saturates
    cruise = np.minimum(np.maximum((distance - knee) / top, 0.0), elapsed)  # [s] at top speed
    left = distance - cruise * top  # error when the cruise ends
    lag = np.maximum(lag, 1e-12)
    final = left * np.exp((cruise - elapsed) / lag)
    return np.copysign(distance - final, error), np.copysign(np.minimum(final / lag, top), error)
