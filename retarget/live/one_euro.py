"""The One-Euro filter (Casiez, Roussel and Vogel, CHI 2012) on many sensors at once, driven by their own times.

A low-pass filter of first order whose cutoff rises with the speed: it smooths what stands and follows what moves. The
speed is the norm of the whole vector, so that turning the world turns the result and changes nothing else.
"""

from dataclasses import dataclass
from math import isfinite, pi

import numpy as np

from retarget.frames import BoolArray
from retarget.rotations import FloatArray

__all__ = ["OneEuro", "OneEuroSettings"]


@dataclass(frozen=True, slots=True)
class OneEuroSettings:
    """min_cutoff: Hz, at rest. beta: Hz by which the cutoff rises per unit of speed (1/m for positions, 1/rad for
    turns). d_cutoff: Hz, of the speed's own filter. Positive and finite; beta may be 0. Raises ValueError otherwise."""

    min_cutoff: float = 0.8
    beta: float = 2.0
    d_cutoff: float = 1.0

    def __post_init__(self) -> None:
        for name, least in (("min_cutoff", 1e-3), ("beta", 0.0), ("d_cutoff", 1e-3)):
            value = getattr(self, name)
            if not (isfinite(value) and value >= least):
                raise ValueError(f"{name} of a One-Euro filter is a number from {least} on; found {value}")


class OneEuro:
    """Filters k vectors of d components. What a row was last is kept while it is NaN or its time stands."""

    def __init__(self, count: int, width: int, settings: OneEuroSettings) -> None:
        self._settings = settings
        self._value = np.full((count, width), np.nan)
        self._speed = np.zeros((count, width))
        self._time = np.full(count, np.nan)

    def step(self, time: FloatArray, value: FloatArray) -> FloatArray:
        """Filtered values (k, d) of values (k, d) at times (k) in s, each of its own row.

        A row's first value is taken as it is; where a value or its time is NaN, the answer is NaN; where the time has
        not risen, it is what it was. Between two calls a row moves a share of the way to its new value, never beyond.
        """
        fresh = np.asarray(np.isnan(self._value).any(axis=1))
        delta = np.where(fresh[:, None], 0.0, value - self._value)
        moved = self.increment(time, delta)
        told = np.asarray(~np.isnan(delta + time[:, None]).any(axis=1))
        self._value = np.where(told[:, None], np.where(fresh[:, None], value, self._value + moved), self._value)
        return np.where(told[:, None], self._value, np.nan)

    def increment(self, time: FloatArray, delta: FloatArray) -> FloatArray:
        """What to add (k, d) to the filtered values, of which the new ones are ahead by delta (k, d); 0 where NaN.

        For values that are not vectors (rotations): the caller keeps them and tells the differences.
        """
        settings = self._settings
        told = ~(np.isnan(delta).any(axis=1) | np.isnan(time))
        elapsed = time - self._time
        steps = told & (elapsed > 0.0)
        self._time = np.where(told & ~(elapsed <= 0.0), time, self._time)
        dt = np.where(steps, elapsed, 1.0)[:, None]
        delta = np.where(steps[:, None], delta, 0.0)
        speed = self._speed + _share(settings.d_cutoff, dt) * (delta / dt - self._speed)
        self._speed = np.where(steps[:, None], speed, self._speed)
        size = np.sqrt(np.einsum("ij,ij->i", self._speed, self._speed))[:, None]
        return np.asarray(_share(settings.min_cutoff + settings.beta * size, dt) * delta)

    def reset(self, rows: BoolArray | slice = slice(None)) -> None:
        """Forget rows (k,): the next value is taken as it is."""
        self._value[rows] = np.nan
        self._speed[rows] = 0.0
        self._time[rows] = np.nan


def _share(cutoff: FloatArray | float, dt: FloatArray) -> FloatArray:
    """The share (0 to 1) of a step that a low-pass filter of this cutoff (Hz) takes in dt s."""
    turn = 2.0 * pi * cutoff * dt
    return np.asarray(turn / (turn + 1.0))
