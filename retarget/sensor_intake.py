"""Sensors as they are asked of the body: without leaps.

A lost sensor, one that comes back, and one that jumps faster than any human become an offset that fades: what is asked
stays continuous, and ends where the sensor is.
"""

from dataclasses import dataclass
from math import exp

import numpy as np

from retarget.frames import BoolArray
from retarget.rotations import FloatArray

__all__ = ["IntakeTimes", "SensorIntake"]

FASTEST_M_S = 15.0
"""Nothing that a person wears moves faster: the fist of a boxer reaches about 10 m/s."""


@dataclass(frozen=True)
class IntakeTimes:
    """s. hold: so long a lost sensor is taken to stand still; then it takes no part. fade: time constant with which an
    offset fades."""

    hold: float = 0.2
    fade: float = 0.1


class SensorIntake:
    """`position` (k, 3) m and `present` (k,): what is asked, in the world, of each of k sensors."""

    def __init__(self, count: int, times: IntakeTimes | None = None) -> None:
        self._times = times or IntakeTimes()
        self.position = np.zeros((count, 3))
        self.present: BoolArray = np.zeros(count, dtype=bool)
        self.measured = np.zeros((count, 3))
        self._offset = np.zeros((count, 3))
        self._lost_for = np.full(count, np.inf)
        self._is_fading = False

    def start(self, position: FloatArray, valid: BoolArray) -> None:
        """The first sample: what is valid is taken as it is."""
        self.position[:] = np.where(valid[:, None], position, 0.0)
        self.measured[:] = self.position
        self.present[:] = valid
        self._offset[:] = 0.0
        self._lost_for[:] = np.where(valid, 0.0, np.inf)
        self._is_fading = False

    def step(self, position: FloatArray, valid: BoolArray, *, reached: FloatArray, dt: float) -> None:
        """The sample `dt` seconds later. reached (k, 3): where the body has the sensors now."""
        moved = position - self.measured
        # NaN compares false: an invalid sensor never counts as a calm one.
        calm = (moved * moved).sum(axis=1) <= (FASTEST_M_S * dt) ** 2
        if not (calm & valid).all() or self._lost_for.any():
            self._take_irregular(position, valid, calm, reached=reached, dt=dt)
        else:
            self.measured[:] = position
        if self._is_fading:
            self._offset *= exp(-dt / self._times.fade)
            self._is_fading = bool(np.abs(self._offset).max() > 1e-6)
            np.add(self.measured, self._offset, out=self.position)
        else:
            self.position[:] = self.measured

    def _take_irregular(
        self, position: FloatArray, valid: BoolArray, calm: BoolArray, *, reached: FloatArray, dt: float
    ) -> None:
        """Losses, returns and leaps."""
        absent_before = ~self.present
        back = valid & (absent_before | (self._lost_for > 0.0))
        leap = valid & ~calm & ~back
        asked_before = np.where(absent_before[:, None], reached, self.position)
        changed = back | leap
        self._offset[changed] = asked_before[changed] - position[changed]
        self.measured[valid] = position[valid]
        self._lost_for[valid] = 0.0
        self._lost_for[~valid] += dt
        self.present[:] = self._lost_for <= self._times.hold
        self._is_fading = self._is_fading or bool(changed.any())
