"""When a live performer is followed and when the robot holds: debounce, reacquisition blends, weights of sensors."""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from retarget import rotations
from retarget.errors import UsageError
from retarget.frames import SensorSample
from retarget.live.sensor_validity import StateArray, ValidityState
from retarget.types import BoolArray, FloatArray

# Whether something has been good for long enough to be used again.


class Debounce:
    """Becomes true after `healthy` s of good without a break. good: whether it begins as true."""

    def __init__(self, healthy: float, *, good: bool = False) -> None:
        self._healthy = healthy
        self._since = -float("inf") if good else None

    def restart(self) -> None:
        """Wait for `healthy` s from the next good step on."""
        self._since = None

    def step(self, now: float, *, good: bool) -> bool:
        """Whether it has been good for long enough at `now`, s."""
        if not good:
            self._since = None
        elif self._since is None:
            self._since = now
        return self._since is not None and now - self._since >= self._healthy


class Engaged(Enum):
    """Whether the performer is followed."""

    FOLLOWING = "following"
    HOLDING = "holding"


@dataclass(frozen=True, kw_only=True)
class EngagementTimes:
    """Times and speeds of the end of a hold. healthy: s of good data before it ends. blend: least duration of the
    blend back to the performer, s. speed: m/s, and turn: rad/s, that no sensor exceeds during this blend."""

    healthy: float = 0.5
    blend: float = 0.75
    speed: float = 0.6
    turn: float = 2.0


PEAK = 1.5
"""Peak speed of a smoothstep over its mean."""


class Engagement:
    """Follows samples, or holds the last one. After a hold it blends back to the performer without a jump.

    It begins as after a hold, with the sample that the robot has approached.
    """

    def __init__(self, first: SensorSample, times: EngagementTimes | None = None) -> None:
        self._times = times or EngagementTimes()
        self.wanted = True
        """Whether the robot is to follow: False while a pedal or key is released."""
        self.settled: float
        """Share of its speed that the robot may use beyond that of its slow approach: 0 until the blend back is over,
        then up to 1 in `blend` s."""
        self._good = Debounce(self._times.healthy)
        self._began = -np.inf  # [s] of the blend back
        self._duration = 0.0
        self.begin(first)

    def begin(self, first: SensorSample) -> None:
        """Begin as after a hold: the robot is where `first` commands it to be."""
        self.state, self.settled = Engaged.HOLDING, 0.0
        self._held = self._shown = first
        self._good.restart()

    @property
    def shown(self) -> SensorSample:
        """The sample that was followed last."""
        return self._shown

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
        self.settled = min(max((now - self._began - self._duration) / self._times.blend, 0.0), 1.0)
        self._shown = sample if share >= 1.0 else _blend(self._held, sample, share * share * (3.0 - 2.0 * share))
        return self._shown

    def _blend_time(self, sample: SensorSample) -> float:
        """Duration of the blend from the held sample to the present one, s."""
        both = self._held.valid & sample.valid
        distance = np.linalg.norm(sample.position[both] - self._held.position[both], axis=1)
        turned = _turned(self._held, sample)
        angle = rotations.angle_between(self._held.orientation[turned], sample.orientation[turned])
        times = self._times
        slowest = max(float(distance.max(initial=0.0)) / times.speed, float(angle.max(initial=0.0)) / times.turn)
        return max(times.blend, PEAK * slowest)


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


@dataclass(frozen=True, kw_only=True)
class ReacquisitionTimes:
    """Times of the weights, s. leave: from full weight to none. healthy: a sensor must be valid for this long before it
    comes back. blend: from none to full weight. Raises UsageError for a time that is not positive."""

    leave: float = 0.07
    healthy: float = 0.5
    blend: float = 0.75

    def __post_init__(self) -> None:
        if not all(0.0 < value < np.inf for value in (self.leave, self.healthy, self.blend)):
            raise UsageError("reacquisition times out of range", found=repr(self), allowed="positive seconds")


class ReacquisitionBlend:
    """The `weights` (k,), 0 to 1, of k sensors; 0 at first. They rise and fall by smoothsteps, and may turn midway."""

    def __init__(self, count: int, times: ReacquisitionTimes | None = None) -> None:
        self._times = times or ReacquisitionTimes()
        self._share = np.zeros(count)
        self._fresh_for = np.zeros(count)
        self.weights: FloatArray = np.zeros(count)
        self._full = False

    def start(self, states: StateArray) -> None:
        """Give every valid sensor full weight at once: for a body that does not move yet."""
        self._share = (states == ValidityState.FRESH).astype(np.float64)
        self._fresh_for = self._share * self._times.healthy
        self.weights = self._share.copy()
        self._full = False

    def step(self, states: StateArray, dt: float) -> FloatArray:
        """Weights (k,) `dt` s later, for the states (k,) of now."""
        if self._full and not np.count_nonzero(states):
            return self.weights
        fresh = states == ValidityState.FRESH
        dt = min(max(dt, 0.0), LONGEST_STEP)
        self._fresh_for = np.where(fresh, self._fresh_for + dt, 0.0)
        back = self._fresh_for > self._times.healthy
        # A sensor that was invalid fades out whole before it comes back, unless it is valid for long enough by then.
        change = np.where(back, dt / self._times.blend, -dt / self._times.leave)
        self._share = np.clip(self._share + change, 0.0, 1.0)
        self.weights = self._share * self._share * (3.0 - 2.0 * self._share)
        self._full = bool((self._share == 1.0).all())
        return self.weights


# Orientations of sensors that come back: blended by their weight from the last known orientation.


class ReacquisitionTurn:
    """Keeps the last orientation that each of `count` sensors had at full weight."""

    def __init__(self, count: int) -> None:
        self._last: FloatArray = np.full((count, 4), np.nan)

    def step(self, sample: SensorSample) -> SensorSample:
        """The sample, with the orientations of sensors that come back blended from the last known ones."""
        if sample.weight is None:
            return sample
        whole = sample.valid & (sample.weight >= 1.0)
        if np.count_nonzero(whole) == len(whole):
            self._last = sample.orientation
            return sample
        self._last = np.where(whole[:, None], sample.orientation, self._last)
        back = sample.valid & ~whole & np.isfinite(self._last[:, 0]) & np.isfinite(sample.orientation[:, 0])
        if not back.any():
            return sample
        orientation = sample.orientation.copy()
        orientation[back] = rotations.slerp(self._last[back], orientation[back], sample.weight[back])
        return SensorSample(sample.names, sample.position, orientation, sample.valid, sample.weight)
