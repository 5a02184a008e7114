"""Sensors as they are asked of the body: without leaps.

A lost sensor, one that comes back, and one that jumps faster than any human become an offset that fades: what is asked
stays continuous, and ends where the sensor is. Who comes back by a weight does so from where the body has it, slowly.
"""

from dataclasses import dataclass
from math import exp

import numpy as np

from retarget import rotations
from retarget.frames import BoolArray
from retarget.rotations import FloatArray

__all__ = ["IntakeTimes", "SensorIntake"]

FASTEST_M_S = 15.0
"""Nothing that a person wears moves faster: the fist of a boxer reaches about 10 m/s."""


@dataclass(frozen=True)
class IntakeTimes:
    """s. hold: so long a lost sensor is taken to stand still; then it takes no part. fade: time constant with which an
    offset fades. speed: m/s, no more, at which one that comes back by its weight goes from where the body has it."""

    hold: float = 0.2
    fade: float = 0.1
    speed: float = 0.6


class SensorIntake:
    """`position` (k, 3) m and `present` (k,): what is asked, in the world, of each of k sensors. `all_present`: whether
    something is asked of all."""

    def __init__(self, count: int, times: IntakeTimes | None = None) -> None:
        self._times = times or IntakeTimes()
        self.position = np.zeros((count, 3))
        self.present: BoolArray = np.zeros(count, dtype=bool)
        self.all_present = False
        self.measured = np.zeros((count, 3))
        self._offset = np.zeros((count, 3))
        self._lost_for = np.full(count, np.inf)
        self._has_lost = True
        self._is_fading = False
        self._away = np.zeros((count, 3))  # [m] from who comes back by weight to where the body had it
        self._left = np.zeros(count)  # share of that
        self._is_returning = False
        self._back: BoolArray = np.zeros(count, dtype=bool)  # who came back in this tick

    def start(self, position: FloatArray, valid: BoolArray) -> None:
        """The first sample: what is valid is taken as it is."""
        self.position[:] = np.where(valid[:, None], position, 0.0)
        self.measured[:] = self.position
        self.present[:] = valid
        self.all_present = bool(valid.all())
        self._offset[:] = 0.0
        self._lost_for[:] = np.where(valid, 0.0, np.inf)
        self._has_lost = not self.all_present
        self._is_fading = False
        self._left[:] = 0.0
        self._is_returning = False

    def step(
        self,
        position: FloatArray,
        valid: BoolArray,
        *,
        reached: FloatArray,
        dt: float,
        weight: FloatArray | None = None,
    ) -> None:
        """The sample `dt` seconds later. reached (k, 3): where the body has the sensors now. weight (k,): how far who
        was lost has come back; None: everybody has."""
        moved = position - self.measured
        # NaN compares false: an invalid sensor never counts as a calm one.
        calm = rotations.squares(moved) <= (FASTEST_M_S * dt) ** 2
        if self._has_lost or np.count_nonzero(calm & valid) != len(calm):
            self._take_irregular(position, valid, calm, reached=reached, dt=dt)
            if weight is not None:
                self._begin_return(weight)
        else:
            self.measured[:] = position
        if self._is_fading:
            self._offset *= exp(-dt / self._times.fade)
            self._is_fading = bool(np.abs(self._offset).max() > 1e-6)
            np.add(self.measured, self._offset, out=self.position)
        else:
            self.position[:] = self.measured
        if self._is_returning:
            self._return(np.ones_like(self._left) if weight is None else weight, dt)

    def _begin_return(self, weight: FloatArray) -> None:
        """Whoever has just come back by a weight does not fade."""
        slowly = self._back & (weight < 1.0)
        self._away[slowly], self._left[slowly] = self._offset[slowly], 1.0
        self._offset[slowly] = 0.0
        self._left[self._back & ~slowly] = 0.0
        self._is_returning = bool(self._left.any())

    def _return(self, weight: FloatArray, dt: float) -> None:
        """What is left of the way back; it never grows, and is gone no faster than it may be."""
        far = np.linalg.norm(self._away, axis=1)
        fastest = self._times.speed * dt / np.maximum(far, self._times.speed * dt)
        self._left = np.maximum(np.minimum(1.0 - weight, self._left), self._left - fastest)
        self._is_returning = bool(self._left.any())
        self.position += self._left[:, None] * self._away

    def _take_irregular(
        self, position: FloatArray, valid: BoolArray, calm: BoolArray, *, reached: FloatArray, dt: float
    ) -> None:
        """Losses, returns and leaps."""
        absent_before = ~self.present
        back = valid & (absent_before | (self._lost_for > 0.0))
        leap = valid & ~calm & ~back
        asked_before = np.where(absent_before[:, None], reached, self.position)
        changed = back | leap
        self._back = back
        self._offset[changed] = asked_before[changed] - position[changed]
        self.measured[valid] = position[valid]
        self._lost_for[valid] = 0.0
        self._lost_for[~valid] += dt
        self._has_lost = not valid.all()
        self.present[:] = self._lost_for <= self._times.hold
        self.all_present = bool(self.present.all())
        self._is_fading = self._is_fading or bool(changed.any())
