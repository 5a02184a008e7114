"""From where on a sensor is not believed."""

from dataclasses import dataclass

import numpy as np

from retarget.errors import UsageError
from retarget.sources.pose_bounds import NORM_TOLERANCE

__all__ = ["TrustLimits"]


@dataclass(frozen=True, kw_only=True)
class TrustLimits:
    """Limits of trust. Lengths m, times s of capture unless said otherwise. Raises UsageError for what makes no sense.

    fastest: m/s; the fist of a boxer reaches about 10. shortest_step: a shorter time between two poses counts as this:
    stamps taken on arrival are off by 15 ms, and a sender of 200 Hz may repeat a tracker of 60 Hz. settled_after: a
    sensor that jumped, or changed places, is believed again when it went on from there for so long. exchange: nearer
    ones may change places unseen. stale_after: without an accepted pose, on the local clock; a feed of 20 Hz may lose
    one pose of three. frozen_after: repeating one value; with `Rejoin`'s way out it makes 0.3 s. noticeable: how far
    another one must have moved, in m and in parts of a unit quaternion (0.0087: one degree), to say that somebody
    moves. not_worn_after: from the first judgement. reach: horizontally from the origin, along each axis. low, high:
    of the height. norm_tolerance: of a quaternion's norm.
    """

    fastest: float = 15.0
    shortest_step: float = 1.0 / 60.0
    settled_after: float = 0.5
    exchange: float = 0.08
    stale_after: float = 0.142
    frozen_after: float = 0.2
    noticeable: tuple[float, float] = (0.01, 0.0087)
    not_worn_after: float = 3.0
    reach: float = 10.0
    low: float = -1.0
    high: float = 3.0
    norm_tolerance: float = NORM_TOLERANCE

    def __post_init__(self) -> None:
        positive = (
            *(self.fastest, self.shortest_step, self.settled_after, self.exchange, self.stale_after),
            *(self.frozen_after, *self.noticeable, self.not_worn_after, self.reach, self.norm_tolerance),
        )
        # Comparisons with NaN are False.
        if not (all(value > 0.0 for value in positive) and -np.inf < self.low < self.high < np.inf):
            raise UsageError(
                "limits of trust make no sense",
                found=repr(self),
                allowed="positive numbers, and low below high",
                next_step="Correct them",
            )
