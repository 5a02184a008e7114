"""When a live performer is followed, and when the robot holds: data must be good, and coming back is slow."""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from retarget import rotations
from retarget.frames import SensorSample
from retarget.rotations import FloatArray

__all__ = ["Engaged", "Engagement", "EngagementTimes"]


class Engaged(Enum):
    """Whether the performer is followed."""

    FOLLOWING = "following"
    HOLDING = "holding"


@dataclass(frozen=True, kw_only=True)
class EngagementTimes:
    """healthy: s of good data before a hold ends. blend: s that coming back takes, at least; speed: m/s that no sensor
    exceeds on the way back from where it was held."""

    healthy: float = 0.5
    blend: float = 0.75
    speed: float = 0.6


PEAK = 1.5
"""Peak speed of a smoothstep over its mean."""


class Engagement:
    """Follows samples, or holds at the last one; from there back to the performer without a leap.

    It begins with the sample at which the robot arrives, as after a hold.
    """

    def __init__(self, first: SensorSample, times: EngagementTimes | None = None) -> None:
        self._times = times or EngagementTimes()
        self.state = Engaged.HOLDING
        self.wanted = True
        """Whether the performer wants to be followed: a pedal or key may let go."""
        self._held = self._shown = first
        self._healthy_since: float | None = None
        self._began = -np.inf  # [s] when it came back
        self._duration = 0.0

    @property
    def shown(self) -> SensorSample:
        """The sample that was followed last."""
        return self._shown

    def hold(self) -> None:
        """Hold from now on, until data are good for long enough."""
        if self.state is Engaged.FOLLOWING:
            self._held = self._shown
        self.state, self._healthy_since = Engaged.HOLDING, None

    def step(self, now: float, sample: SensorSample, *, good: bool) -> SensorSample | None:
        """What to follow at `now`, s; None: hold. good: whether what the sensors say can be believed."""
        if not good or not self.wanted:
            self.hold()
            return None
        if self.state is Engaged.HOLDING:
            if self._healthy_since is None:
                self._healthy_since = now
            if now - self._healthy_since < self._times.healthy:
                return None
            self.state, self._began, self._duration = Engaged.FOLLOWING, now, self._way_back(sample)
        share = (now - self._began) / self._duration
        self._shown = sample if share >= 1.0 else _blend(self._held, sample, share * share * (3.0 - 2.0 * share))
        return self._shown

    def _way_back(self, sample: SensorSample) -> float:
        """How long the way back takes, s."""
        both = self._held.valid & sample.valid
        distance = np.linalg.norm(sample.position[both] - self._held.position[both], axis=1)
        return max(self._times.blend, PEAK * float(distance.max(initial=0.0)) / self._times.speed)


def _blend(held: SensorSample, sample: SensorSample, share: float) -> SensorSample:
    """From the held sample (share 0) to the present one; sensors that were not held are as they are."""
    both = held.valid & sample.valid
    position: FloatArray = sample.position.copy()
    position[both] += (1.0 - share) * (held.position[both] - sample.position[both])
    orientation = sample.orientation.copy()
    turned = both & np.isfinite(held.orientation[:, 0]) & np.isfinite(sample.orientation[:, 0])
    if turned.any():
        orientation[turned] = rotations.slerp(held.orientation[turned], sample.orientation[turned], share)
    return SensorSample(sample.names, position, orientation, sample.valid)
