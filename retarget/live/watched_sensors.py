"""The memory of trust: the last accepted pose of each sensor, who repeats one value, and which poses are sound."""

from retarget._solver import WatchedSensors
from retarget.live.trust_limits import TrustLimits

__all__ = ["watched_sensors"]


def watched_sensors(count: int, limits: TrustLimits) -> WatchedSensors:
    """Of k sensors that were never heard."""
    return WatchedSensors(
        count,
        reach=limits.reach,
        height=(limits.low, limits.high),
        norm_tolerance=limits.norm_tolerance,
        stale_after=limits.stale_after,
        frozen_after=limits.frozen_after,
        noticeable=limits.noticeable,
        not_worn_after=limits.not_worn_after,
    )
