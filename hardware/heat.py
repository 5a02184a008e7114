"""Forecast of the first overheating warning among the servos that carry a robot.

A servo under a steady load warms as a first-order lag with time constant tau:

  T(t) = T_end - (T_end - T) exp(-t / tau),    T_end = T + tau dT/dt

It reaches W after tau ln((T_end - T) / (T_end - W)), or never.
"""

from dataclasses import dataclass
from math import exp, inf, log

import numpy as np

from hardware.arrays import BoolArray, FloatArray

THERMAL_S = 300.0
"""[s] Time constant of a servo's case, as simulated. None was stated or measured."""
RATE_S = 60.0
"""[s] Averaging time, since the register has steps of one degree."""
EVERY_S = 1.0  # the register has steps of one degree and is read every 0.2 s


@dataclass(frozen=True)
class HeatLeft:
    """The servo that warns first. column: in servo order. temperature, warns_at: degrees Celsius. per_minute: degrees.
    left: s; inf: never."""

    column: int
    temperature: float
    warns_at: float
    per_minute: float
    left: float


class HeatForecast:
    """Forecast from temperatures (n,). soonest: None before RATE_S."""

    def __init__(self, warns_at: float, servos: BoolArray | None = None) -> None:
        """warns_at: degrees Celsius. servos (n,): mask; None: all."""
        self._warns_at, self._servos = warns_at, servos
        self._begun = self._seen = -inf
        self._slow: FloatArray | None = None
        self.soonest: HeatLeft | None = None

    def look(self, time: float, temperature: FloatArray) -> bool:
        """Update with temperatures (n,), degrees Celsius, at a time, s. Return True if due."""
        if time - self._seen < EVERY_S or not np.isfinite(self._warns_at):
            return False
        elapsed, self._seen = time - self._seen, time
        known = np.where(np.isfinite(temperature), temperature, np.nan)
        if self._slow is None:
            self._slow, self._begun = known, time
        slow = np.where(np.isnan(self._slow), known, self._slow)
        self._slow = slow + (1.0 - exp(-min(elapsed, 10.0 * RATE_S) / RATE_S)) * (known - slow)
        if time - self._begun >= RATE_S:
            found: list[HeatLeft] = []
            rates = ((known - self._slow) / RATE_S).tolist()
            for column, (now, per_s) in enumerate(zip(known.tolist(), rates, strict=True)):
                if np.isnan(per_s) or (self._servos is not None and not self._servos[column]):
                    continue
                found.append(HeatLeft(column, now, self._warns_at, 60.0 * per_s, time_left(now, per_s, self._warns_at)))
            self.soonest = min(found, key=lambda one: (one.left, -one.temperature), default=None)
        return True


def time_left(temperature: float, rate: float, warns_at: float) -> float:
    """The time, s, until a servo that warms at `rate`, K/s, reaches `warns_at`."""
    if temperature >= warns_at:
        return 0.0
    end = temperature + THERMAL_S * rate
    return THERMAL_S * log((end - temperature) / (end - warns_at)) if end > warns_at else inf
