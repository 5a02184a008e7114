"""When a live performer is followed, and when the robot holds: data must be good, and coming back is slow."""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from retarget import rotations
from retarget.frames import BoolArray, SensorSample
from retarget.live.lasting import Lasting
from retarget.rotations import FloatArray

__all__ = ["Engaged", "Engagement", "EngagementTimes"]


class Engaged(Enum):
    """Whether the performer is followed."""

    FOLLOWING = "following"
    HOLDING = "holding"


@dataclass(frozen=True, kw_only=True)
class EngagementTimes:
    """healthy: s of good data before a hold ends. blend: s that coming back takes, at least; speed: m/s, and turn:
    rad/s, that no sensor exceeds on the way back from where it was held."""

    healthy: float = 0.5
    blend: float = 0.75
    speed: float = 0.6
    turn: float = 2.0


PEAK = 1.5
"""Peak speed of a smoothstep over its mean."""


class Engagement:
    """Follows samples, or holds at the last one; from there back to the performer without a leap.

    It begins with the sample at which the robot arrives, as after a hold.
    """

    def __init__(self, first: SensorSample, times: EngagementTimes | None = None) -> None:
        self._times = times or EngagementTimes()
        self.wanted = True
        """Whether the performer wants to be followed: a pedal or key may let go."""
        self.settled: float
        """How much of its speed the robot may use beyond that of its slow approach: 0 until the way back is over, from
        there to 1 in `blend` s."""
        self._good = Lasting(self._times.healthy)
        self._began = -np.inf  # [s] when it came back
        self._duration = 0.0
        self.begin(first)

    def begin(self, first: SensorSample) -> None:
        """The robot is where `first` wants it, as after a hold."""
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
        """What to follow at `now`, s; None: hold. good: whether what the sensors say can be believed."""
        if not good or not self.wanted:
            self.hold()
            return None
        if self.state is Engaged.HOLDING:
            if not self._good.step(now, good=True):
                return None
            self.state, self._began, self._duration = Engaged.FOLLOWING, now, self._way_back(sample)
        share = (now - self._began) / self._duration
        self.settled = min(max((now - self._began - self._duration) / self._times.blend, 0.0), 1.0)
        self._shown = sample if share >= 1.0 else _blend(self._held, sample, share * share * (3.0 - 2.0 * share))
        return self._shown

    def _way_back(self, sample: SensorSample) -> float:
        """How long the way back takes, s."""
        both = self._held.valid & sample.valid
        distance = np.linalg.norm(sample.position[both] - self._held.position[both], axis=1)
        turned = _turned(self._held, sample)
        angle = rotations.angle_between(self._held.orientation[turned], sample.orientation[turned])
        times = self._times
        slowest = max(float(distance.max(initial=0.0)) / times.speed, float(angle.max(initial=0.0)) / times.turn)
        return max(times.blend, PEAK * slowest)


def _turned(held: SensorSample, sample: SensorSample) -> BoolArray:
    """Who is valid in both and says how it is turned, (k,)."""
    known = np.isfinite(held.orientation[:, 0]) & np.isfinite(sample.orientation[:, 0])
    return np.asarray(held.valid & sample.valid & known)


def _blend(held: SensorSample, sample: SensorSample, share: float) -> SensorSample:
    """From the held sample (share 0) to the present one; sensors that were not held are as they are."""
    both = held.valid & sample.valid
    position: FloatArray = sample.position.copy()
    position[both] += (1.0 - share) * (held.position[both] - sample.position[both])
    orientation = sample.orientation.copy()
    turned = _turned(held, sample)
    if turned.any():
        orientation[turned] = rotations.slerp(held.orientation[turned], sample.orientation[turned], share)
    return SensorSample(sample.names, position, orientation, sample.valid, sample.weight)
