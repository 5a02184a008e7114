"""How a live performer's sensors are smoothed: One-Euro filter or fixed lag, by name."""

from dataclasses import dataclass
from math import isfinite

import numpy as np

from retarget import _solver
from retarget.errors import UsageError, suggest
from retarget.rotations import IDENTITY
from retarget.types import BoolArray, FloatArray

__all__ = [
    "LIGHT",
    "SMOOTHINGS",
    "WINDOW",
    "FixedLag",
    "OneEuroSettings",
    "PoseFilter",
    "Smoothed",
    "WindowFilter",
    "pose_filter",
]


# Settings of the One-Euro filter (Casiez, Roussel and Vogel, CHI 2012).


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

    @property
    def cutoffs(self) -> tuple[float, float, float]:
        """As the compiled filter takes them."""
        return self.min_cutoff, self.beta, self.d_cutoff


# Smooth poses: the One-Euro filter (Casiez, Roussel and Vogel, CHI 2012) on positions and turns, by their own times.
#
# A low-pass filter of first order whose cutoff rises with the speed: it smooths what stands and follows what moves. The
# speed is the norm of the whole vector, so that turning the world turns the result and changes nothing else. A turn is
# filtered as the rotation vector from the filtered orientation to the new one, seen from the world, never as that of
# the
# orientation itself, which leaps at 180 degrees. So the signs of quaternions say nothing.


class PoseFilter:
    """Filters the poses of k sensors. position, orientation: settings of either part; None leaves it as it is."""

    def __init__(self, count: int, *, position: OneEuroSettings | None, orientation: OneEuroSettings | None) -> None:
        self._filter = _solver.PoseFilter(
            count,
            position=None if position is None else position.cutoffs,
            orientation=None if orientation is None else orientation.cutoffs,
        )

    def step(self, time: FloatArray, position: FloatArray, orientation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Filtered positions (k, 3) and orientations (k, 4) wxyz, unit, of poses at times (k) in s.

        A first value is taken as it is. NaN in, NaN out, and the state waits. Where the time has not risen the answer
        is what it was. Between two calls a pose moves a share of the way to its new value, never beyond. The sign of an
        orientation is that of the one before.
        """
        return self._filter.step(time, np.ascontiguousarray(position), np.ascontiguousarray(orientation))

    def reset(self, rows: BoolArray) -> None:
        """Forget rows (k,): their next pose is taken as it is."""
        self._filter.reset(rows)


# Smooth poses at the price of a fixed lag: a Gaussian window over what came before and after.

SIGMAS = 2.5
"""Half of the window, in standard deviations."""
_FOUR = np.ones(4)
"""(values * values).dot(_FOUR) is the quickest sum over rows of four."""


@dataclass(frozen=True, slots=True, eq=False)
class Smoothed:
    """k poses. time (k): s, when they were so: the mean of the times that were taken. position (k, 3) m, orientation
    (k, 4) wxyz; NaN where nothing was told."""

    time: FloatArray
    position: FloatArray
    orientation: FloatArray


class FixedLag:
    """Weighted means of the poses of k sensors over a window of `length` s, half of which is the lag.

    The time that is told with a mean is the mean of the times with the same weights: motion along a line at an even
    speed is exact, however irregular the times, and nothing overshoots. At most `depth` poses are kept of each sensor.
    """

    def __init__(self, count: int, *, length: float = 0.120, depth: int = 64) -> None:
        assert length > 0.0 and depth > 1
        self._half = 0.5 * length
        self._depth = depth
        self._time = np.full((count, depth), np.inf)  # of nothing: outside of every window
        self._position = np.zeros((count, depth, 3))
        self._orientation = np.zeros((count, depth, 4))
        self._newest = np.full(count, -np.inf)
        self._next = np.zeros(count, dtype=np.intp)
        self._every = np.arange(count)

    def step(self, time: FloatArray, position: FloatArray, orientation: FloatArray) -> Smoothed:
        """Take poses at times (k) in s and tell the means half a window before the newest.

        position (k, 3) m, orientation (k, 4) wxyz of any sign. A row whose time has not risen, or that has any NaN, is
        not taken.
        """
        whole = np.isfinite(time) & np.isfinite(position).all(axis=1) & np.isfinite(orientation).all(axis=1)
        taken = np.flatnonzero(whole & (time > self._newest))
        place = self._next[taken]
        self._time[taken, place] = time[taken]
        self._position[taken, place] = position[taken]
        self._orientation[taken, place] = orientation[taken]
        self._newest[taken] = time[taken]
        self._next[taken] = (place + 1) % self._depth
        return self._means()

    def reset(self, rows: BoolArray | slice = slice(None)) -> None:
        """Forget rows (k,)."""
        self._time[rows] = np.inf
        self._newest[rows] = -np.inf

    def _means(self) -> Smoothed:
        """The means of every row around half a window before its newest pose."""
        told = self._newest > -np.inf
        newest = np.where(told, self._newest, 0.0)
        # At the start there is less than half a window before the newest: the middle of what there is.
        oldest = np.clip(self._time.min(axis=1), newest - 2.0 * self._half, newest)
        centre = 0.5 * (newest + oldest)
        offset = self._time - centre[:, None]
        inside = np.abs(offset) <= self._half * (1.0 + 1e-9)
        offset = np.where(inside, offset, 0.0)
        weight = np.where(inside, np.exp(offset * offset * (-0.5 * (SIGMAS / self._half) ** 2)), 0.0)
        weight /= np.where(told, weight.sum(axis=1), np.nan)[:, None]
        reference = self._orientation[self._every, weight.argmax(axis=1)]
        same_side = np.matmul(self._orientation, reference[:, :, None])[:, :, 0] >= 0.0
        signed = np.where(same_side, weight, -weight)[:, None, :]
        orientation = np.matmul(signed, self._orientation)[:, 0]
        norm = np.sqrt((orientation * orientation).dot(_FOUR))[:, None]
        time = centre + (weight * offset).sum(axis=1)
        return Smoothed(time, np.matmul(weight[:, None, :], self._position)[:, 0], orientation / norm)


# The fixed-lag smoother as a filter of sensors, any of which may tell a place, a turn, or both.

_NOWHERE = np.zeros(3)


class WindowFilter:
    """As `PoseFilter` is used: poses of k sensors in, smooth ones out, half a window late. length: of the window, s."""

    def __init__(self, count: int, *, length: float = 0.120) -> None:
        self._lag = FixedLag(count, length=length)
        self._told = np.zeros((count, 2), dtype=np.bool_)

    def step(self, time: FloatArray, position: FloatArray, orientation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Smooth positions (k, 3) and orientations (k, 4) wxyz of poses at times (k) in s; NaN in, NaN out.

        A sensor that begins to tell its place or its turn, or ceases to, is smoothed from there on.
        """
        told = np.isfinite(np.stack([position[:, 0], orientation[:, 0]], axis=1))
        changed = (told != self._told).any(axis=1)
        if changed.any():
            self._lag.reset(changed)
            self._told = told
        placed, turned = told[:, :1], told[:, 1:]
        known = told.any(axis=1)
        when = np.where(known, time, np.nan)
        found = self._lag.step(
            when, np.where(placed, position, _NOWHERE), np.where(turned, orientation, np.asarray(IDENTITY))
        )
        return np.where(placed, found.position, np.nan), np.where(turned, found.orientation, np.nan)

    def reset(self, rows: BoolArray) -> None:
        """Forget rows (k,): their next pose is taken as it is."""
        self._lag.reset(rows)


LIGHT = "light"
WINDOW = "window"
"""No One-Euro filter, but the mean over 120 ms: the smoothest, and always 60 ms late."""

SMOOTHINGS: dict[str, tuple[OneEuroSettings, OneEuroSettings] | None] = {
    "off": None,
    LIGHT: (OneEuroSettings(min_cutoff=4.0, beta=12.0), OneEuroSettings(min_cutoff=4.0, beta=3.0)),
    "strong": (OneEuroSettings(min_cutoff=1.0, beta=3.0), OneEuroSettings(min_cutoff=1.0, beta=1.0)),
}
"""Of positions (Hz, and Hz per m/s) and of orientations (Hz, and Hz per rad/s). light: a hand at rest trembles half as
much, and one that goes at 1 m/s lags by 10 ms."""


def pose_filter(name: str, count: int) -> PoseFilter | WindowFilter | None:
    """The filter of k sensors; None: they stay as they are. Raises UsageError for an unknown name."""
    if name == WINDOW:
        return WindowFilter(count)
    if name not in SMOOTHINGS:
        raise UsageError(
            "unknown smoothing",
            where="--smoothing",
            found=repr(name[:80]),
            allowed=", ".join((*SMOOTHINGS, WINDOW)),
            next_step=suggest(name, (*SMOOTHINGS, WINDOW)),
        )
    settings = SMOOTHINGS[name]
    return None if settings is None else PoseFilter(count, position=settings[0], orientation=settings[1])
