"""The One-Euro filter (Casiez, Roussel and Vogel, CHI 2012) on many sensors at once, driven by their own times.

A low-pass filter of first order whose cutoff rises with the speed: it smooths what stands and follows what moves. The
speed is the norm of the whole vector, so that turning the world turns the result and changes nothing else.
"""

from dataclasses import dataclass
from math import isfinite, isnan, pi

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
        self._ones = np.ones(width)

    def step(self, time: FloatArray, value: FloatArray) -> FloatArray:
        """Filtered values (k, d) of values (k, d) at times (k) in s, each of its own row.

        A row's first value is taken as it is; where a value or its time is NaN, the answer is NaN; where the time has
        not risen, it is what it was. Between two calls a row moves a share of the way to its new value, never beyond.
        The array is not to be written to: it is the filter's state.
        """
        delta = value - self._value
        if isnan(delta.sum() + time.sum()):
            return self._step_with_gaps(time, value)
        self._value = self._value + self.shares(time, delta)[:, None] * delta
        return self._value

    def shares(self, time: FloatArray, delta: FloatArray) -> FloatArray:
        """The share (k), 0 to 1, of the way from the filtered values to the new ones, which are ahead by delta (k, d).

        For values that are not vectors (rotations): the caller keeps them and tells the differences. 0 where delta or
        time is NaN, or the time has not risen.
        """
        elapsed = time - self._time
        if not (elapsed > 0.0).all() or isnan(delta.sum()):
            told = ~(np.isnan(delta).any(axis=1) | np.isnan(time))
            steps = told & (elapsed > 0.0)
            self._time = np.where(told & ~(elapsed <= 0.0), time, self._time)
            return np.where(steps, self._shares(np.where(steps, elapsed, np.nan), delta), 0.0)
        self._time = time
        return self._shares(elapsed, delta)

    def _shares(self, dt: FloatArray, delta: FloatArray) -> FloatArray:
        """The shares (k) after dt (k) s; NaN where dt is, and the speed is then what it was."""
        settings = self._settings
        speed = self._speed + _share(settings.d_cutoff, dt)[:, None] * (delta / dt[:, None] - self._speed)
        size = np.sqrt((speed * speed).dot(self._ones))
        if isnan(size.sum()):
            speed = np.where(np.isnan(size)[:, None], self._speed, speed)
        self._speed = speed
        return _share(settings.min_cutoff + settings.beta * size, dt)

    def _step_with_gaps(self, time: FloatArray, value: FloatArray) -> FloatArray:
        """Rows that start, and rows that are not told."""
        fresh = np.isnan(self._value).any(axis=1)
        told = np.asarray(~np.isnan(value + time[:, None]).any(axis=1))[:, None]
        delta = np.where(told, np.where(fresh[:, None], 0.0, value - self._value), np.nan)
        moved = self.shares(time, delta)[:, None] * np.where(told, delta, 0.0)
        self._value = np.where(told, np.where(fresh[:, None], value, self._value + moved), self._value)
        return np.where(told, self._value, np.nan)

    def reset(self, rows: BoolArray | slice = slice(None)) -> None:
        """Forget rows (k,): the next value is taken as it is."""
        # New arrays: the old ones were handed out.
        self._value, self._speed, self._time = self._value.copy(), self._speed.copy(), self._time.copy()
        self._value[rows] = np.nan
        self._speed[rows] = 0.0
        self._time[rows] = np.nan


def _share(cutoff: FloatArray | float, dt: FloatArray) -> FloatArray:
    """The share (0 to 1) of a step that a low-pass filter of this cutoff (Hz) takes in dt s."""
    turn = (2.0 * pi) * cutoff * dt
    return np.asarray(turn / (turn + 1.0))
