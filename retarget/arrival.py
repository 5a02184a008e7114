"""The way of a robot from its stance to where somebody stands still, before it follows."""

from collections.abc import Callable

import numpy as np

from retarget.robot_posture import RobotPosture
from retarget.rotations import FloatArray

__all__ = ["ARRIVAL_S", "RESTING_SPEED", "arrival"]

ARRIVAL_S = 5.0
"""Longest way (s)."""
RESTING_SPEED = 0.1
"""A robot none of whose coordinates is faster (rad/s, m/s) rests, after RESTING_TICKS of it."""
RESTING_TICKS = 5


def arrival(step: Callable[[], RobotPosture], q: FloatArray, dt: float) -> list[RobotPosture]:
    """Postures, `dt` s apart, from q (nq,) until the robot rests. step: the next one."""
    way: list[RobotPosture] = []
    resting = 0
    while resting < RESTING_TICKS and len(way) * dt < ARRIVAL_S:
        before = q
        way.append(step())
        q = way[-1].q
        resting = resting + 1 if float(np.abs(q - before).max()) < RESTING_SPEED * dt else 0
    return way
