"""When a live performer is followed and when the robot holds: debounce, reacquisition blends, weights of sensors."""

from enum import Enum

import numpy as np

from retarget import rotations
from retarget.frames import SensorSample
from retarget.live.sensor_validity import LIMITS, StateArray, ValidityLimits, ValidityState
from retarget.types import BoolArray, FloatArray

# Whether something has been good for long enough to be used again.


class Debounce:
    """Becomes true after `LIMITS.healthy` s of good without a break. good: whether it begins as true."""

    def __init__(self, *, good: bool = False) -> None:
        self.good = good
        """The answer of the last step."""
        self.tries = 0
        """How often it began to be good since it was good for long enough."""
        self._since = -np.inf if good else np.inf

    def restart(self) -> None:
        """Wait anew from the next good step on."""
        self.good, self._since = False, np.inf

    def step(self, now: float, *, good: bool) -> bool:
        """Whether it has been good for long enough at `now`, s."""
        self.tries += good and np.isinf(self._since)
        self._since = min(self._since, now) if good else np.inf
        self.good = now - self._since >= LIMITS.healthy
        self.tries *= not self.good
        return self.good


class Engaged(Enum):
    """Whether the performer is followed."""

    FOLLOWING = "following"
    HOLDING = "holding"


PEAK = 1.5
"""Peak speed of a smoothstep over its mean."""


class Engagement:
    """Follows samples, or holds the last one. After a hold it blends back to the performer without a jump.

    It begins as after a hold, with the sample that the robot has approached.
    """

    def __init__(self, first: SensorSample) -> None:
        self.wanted = True
        """Whether the robot is to follow: False while a pedal or key is released."""
        self.settled = 0.0
        """Share of its speed that the robot may use beyond that of its slow approach: 0 until the blend back is over,
        then up to 1 in `LIMITS.blend` s."""
        self.state = Engaged.HOLDING
        self._held = self._shown = first
        self._good = Debounce()
        self._began = -np.inf  # [s] of the blend back
        self._duration = 0.0

    @property
    def shown(self) -> SensorSample:
        """The sample that was followed last."""
        return self._shown

    @property
    def tries(self) -> int:
        """How often data were good during this hold, but not for long enough."""
        return self._good.tries

    def hold(self) -> None:
        """Hold from now on, until data are good for long enough."""
        if self.state is Engaged.FOLLOWING:
            self._held = self._shown
        self.state, self.settled = Engaged.HOLDING, 0.0
        self._good.restart()

    def step(self, now: float, sample: SensorSample, *, good: bool) -> SensorSample | None:
        """The sample to follow at `now`, s; None: hold. good: whether the sensors are valid."""
        if not good or not self.wanted:
            self.hold()
            return None
        if self.state is Engaged.HOLDING:
            if not self._good.step(now, good=True):
                return None
            self.state, self._began, self._duration = Engaged.FOLLOWING, now, self._blend_time(sample)
        share = (now - self._began) / self._duration
        self.settled = min(max((now - self._began - self._duration) / LIMITS.blend, 0.0), 1.0)
        self._shown = sample if share >= 1.0 else _blend(self._held, sample, share * share * (3.0 - 2.0 * share))
        return self._shown

    def _blend_time(self, sample: SensorSample) -> float:
        """Duration of the blend from the held sample to the present one, s."""
        both = self._held.valid & sample.valid
        distance = np.linalg.norm(sample.position[both] - self._held.position[both], axis=1)
        turned = _turned(self._held, sample)
        angle = rotations.angle_between(self._held.orientation[turned], sample.orientation[turned])
        slowest = max(
            float(distance.max(initial=0.0)) / LIMITS.blend_speed, float(angle.max(initial=0.0)) / LIMITS.blend_turn
        )
        return max(LIMITS.blend, PEAK * slowest)


def _turned(held: SensorSample, sample: SensorSample) -> BoolArray:
    """Which sensors are valid and have an orientation in both samples, (k,)."""
    known = np.isfinite(held.orientation[:, 0]) & np.isfinite(sample.orientation[:, 0])
    return np.asarray(held.valid & sample.valid & known)


def _blend(held: SensorSample, sample: SensorSample, share: float) -> SensorSample:
    """Blend from the held sample (share 0) to the present one. Sensors that were not held are not blended."""
    both = held.valid & sample.valid
    position: FloatArray = sample.position.copy()
    position[both] += (1.0 - share) * (held.position[both] - sample.position[both])
    orientation = sample.orientation.copy()
    turned = _turned(held, sample)
    if turned.any():
        orientation[turned] = rotations.slerp(held.orientation[turned], sample.orientation[turned], share)
    return SensorSample(sample.names, position, orientation, sample.valid, sample.weight)


# The weight of each sensor: it fades when the sensor becomes invalid, and comes back by a reacquisition blend.

LONGEST_STEP = 0.02
"""s; a tick that took longer changes the weights as if it had taken this: they never jump."""


class ReacquisitionBlend:
    """The `weights` (k,), 0 to 1, of k sensors; 0 at first. They rise and fall by smoothsteps, and may turn midway.

    The orientation of a sensor that comes back is blended by its weight from the last one of full weight; its position
    is, by `human.sensor_intake`, from where the body has it.
    """

    def __init__(self, count: int, limits: ValidityLimits = LIMITS) -> None:
        self._limits = limits
        self._share = np.zeros(count)
        self._fresh_for = np.zeros(count)
        self._last: FloatArray = np.full((count, 4), np.nan)
        self.weights: FloatArray = np.zeros(count)
        self._all_full = False

    def start(self, states: StateArray) -> None:
        """Give every valid sensor full weight at once: for a body that does not move yet."""
        self._share = (states == ValidityState.FRESH).astype(np.float64)
        self._fresh_for = self._share * self._limits.healthy
        self.weights, self._all_full = self._share.copy(), bool((self._share == 1.0).all())

    def step(self, states: StateArray, dt: float) -> FloatArray:
        """Weights (k,) `dt` s later, for the states (k,) of now."""
        if self._all_full and not np.count_nonzero(states):
            return self.weights
        dt = min(max(dt, 0.0), LONGEST_STEP)
        self._fresh_for = np.where(states == ValidityState.FRESH, self._fresh_for + dt, 0.0)
        back = self._fresh_for > self._limits.healthy
        # A sensor that was invalid fades out whole before it comes back, unless it is valid for long enough by then.
        change = np.where(back, dt / self._limits.blend, -dt / self._limits.leave)
        self._share = np.clip(self._share + change, 0.0, 1.0)
        self.weights = self._share * self._share * (3.0 - 2.0 * self._share)
        self._all_full = bool((self._share == 1.0).all())
        return self.weights

    def turned(self, orientation: FloatArray) -> FloatArray:
        """Orientations (k, 4) wxyz, blended by the present weights from the last ones of full weight."""
        if self._all_full:
            self._last = orientation
            return orientation
        whole = self.weights == 1.0
        self._last = np.where(whole[:, None], orientation, self._last)
        known = ~whole & np.isfinite(self._last[:, 0]) & np.isfinite(orientation[:, 0])
        blended = orientation.copy()
        blended[known] = rotations.slerp(self._last[known], orientation[known], self.weights[known])
        return blended
