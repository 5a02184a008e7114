"""How much each sensor takes part: it leaves smoothly when it is not believed any more, and comes back by a blend."""

from dataclasses import dataclass

import numpy as np

from retarget.errors import UsageError
from retarget.live.trust_state import StateArray, TrustState
from retarget.rotations import FloatArray

__all__ = ["Rejoin", "RejoinTimes"]

LONGEST_STEP = 0.02
"""s; a tick that comes later moves weights no farther than this: they never jump."""


@dataclass(frozen=True, kw_only=True)
class RejoinTimes:
    """s. leave: from full weight to none. healthy: so long a sensor must be believed before it comes back. blend: from
    none to full weight. Raises UsageError for what is not positive."""

    leave: float = 0.07
    healthy: float = 0.5
    blend: float = 0.75

    def __post_init__(self) -> None:
        if not all(0.0 < value < np.inf for value in (self.leave, self.healthy, self.blend)):
            raise UsageError("times of coming back make no sense", found=repr(self), allowed="positive seconds")


class Rejoin:
    """`weights` (k,), 0 to 1, of k sensors: none at first. Both ways are smoothsteps; one may turn into the other."""

    def __init__(self, count: int, times: RejoinTimes | None = None) -> None:
        self._times = times or RejoinTimes()
        self._share = np.zeros(count)
        self._fresh_for = np.zeros(count)
        self.weights: FloatArray = np.zeros(count)
        self._full = False

    def start(self, states: StateArray) -> None:
        """Whoever is believed takes part in full, at once: for a body that does not move yet."""
        self._share = (states == TrustState.FRESH).astype(np.float64)
        self._fresh_for = self._share * self._times.healthy
        self.weights = self._share.copy()
        self._full = False

    def step(self, states: StateArray, dt: float) -> FloatArray:
        """Weights (k,) `dt` s later, for the states (k,) of now."""
        if self._full and not np.count_nonzero(states):
            return self.weights
        fresh = states == TrustState.FRESH
        dt = min(max(dt, 0.0), LONGEST_STEP)
        self._fresh_for = np.where(fresh, self._fresh_for + dt, 0.0)
        back = self._fresh_for > self._times.healthy
        # What was doubted goes all the way out before it comes back, unless it is believed for long enough by then.
        change = np.where(back, dt / self._times.blend, -dt / self._times.leave)
        self._share = np.clip(self._share + change, 0.0, 1.0)
        self.weights = self._share * self._share * (3.0 - 2.0 * self._share)
        self._full = bool((self._share == 1.0).all())
        return self.weights
