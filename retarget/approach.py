"""From where the robot stands to where following begins: a slow, smooth path through joint space."""

from collections.abc import Iterator

import numpy as np

from hardware.joint_map import JointMap
from retarget.rotations import FloatArray

__all__ = ["approach", "slower_in_line"]

PEAK_SPEED = 1.875
"""Peak speed of a minimum-jerk path over distance / duration: 30 (s^2 - 2 s^3 + s^4) at s = 1/2."""
PEAK_ACCELERATION = 10.0 / np.sqrt(3.0)
"""Peak acceleration of it over distance / duration^2."""
NEAR_RAD = 1e-9


def approach(
    start: FloatArray,
    goal: FloatArray,
    joint_map: JointMap,
    *,
    speed: float,
    dt: float,
    within: float = float("inf"),
) -> Iterator[FloatArray]:
    """Postures (n,) rad every `dt` s from `start`, at rest, to `goal`, at rest (Flash and Hogan 1985).

    speed: share of each servo's greatest speed and acceleration that is not exceeded, but to be there `within` s; those
    themselves never are. Nothing when already there.
    """
    way = goal - start
    distance = np.abs(way)
    if distance.max() < NEAR_RAD:
        return
    duration = _duration(distance, joint_map, speed)
    if duration > within:
        duration = max(within - 2.0 * dt, _duration(distance, joint_map, 1.0))
    # One tick more than needed: what differences of ticks see stays below what the curve itself has.
    ticks = int(np.ceil(duration / dt)) + 1
    for tick in range(1, ticks + 1):
        s = tick / ticks
        yield start + way * (s**3 * (10.0 - 15.0 * s + 6.0 * s**2))
    yield goal


def _duration(distance: FloatArray, joint_map: JointMap, speed: float) -> float:
    """How long a share of the greatest speeds and accelerations takes, s, for distances (n,) rad."""
    return max(
        float((PEAK_SPEED * distance / (speed * joint_map.max_velocity)).max()),
        float(np.sqrt(PEAK_ACCELERATION * distance / (speed * joint_map.max_acceleration)).max()),
    )


def slower_in_line(displacement: FloatArray, change: FloatArray) -> FloatArray:
    """What follows a tick's displacement (n,) rad, in the same direction, when the joints brake together.

    change (n,): most that the displacement of each may change.
    """
    ticks = float((np.abs(displacement) / change).max())
    return displacement * max(1.0 - 1.0 / ticks, 0.0) if ticks > 0.0 else displacement
