"""Where the centre of mass belongs while somebody stands: over the feet, a little ahead of the ankles.

A standing body is in balance when its centre of mass is over the feet that carry it; the faster it travels, the less
that holds, so the weight of this goal falls with speed. Travelling is what the feet do: a crouch moves the head, and
changes nothing here.
"""

from collections.abc import Sequence
from math import exp, hypot

import numpy as np

from retarget.priorities import CentreOfMassTask
from retarget.rotations import FloatArray

__all__ = ["Balance"]

Ground = tuple[float, float]

SPEED_SETTLE_S = 0.2
"""Time constant of the low-pass on the speed of travel."""
LIFT_M = 0.08
"""A foot lifted so far above the other carries half as much."""


class Balance:
    """The goal of an `over_feet` task: `goal` (3,) m, world (z unused), and its `weight`, 0 to 1."""

    def __init__(self, task: CentreOfMassTask) -> None:
        self._task = task
        self._middle: Ground | None = None
        self._velocity: Ground = (0.0, 0.0)
        self.goal: FloatArray = np.zeros(3)
        self.weight = 0.0

    def start(self) -> None:
        """Forget the past: nobody travels."""
        self._middle, self._velocity = None, (0.0, 0.0)

    def step(self, feet: Sequence[Sequence[float]], forward: Ground, *, dt: float) -> None:
        """Go on by `dt` seconds. feet: ankles that are known, x, y, z m. forward: the heading, a unit vector."""
        if not feet:
            self._middle, self.weight = None, 0.0
            return
        lowest = min(foot[2] for foot in feet)
        loads = [1.0 / (1.0 + ((foot[2] - lowest) / LIFT_M) ** 2) for foot in feet]
        total = sum(loads)
        for axis in (0, 1):
            over = sum(load * foot[axis] for load, foot in zip(loads, feet, strict=True)) / total
            self.goal[axis] = over + self._task.forward * forward[axis]
        self._travel(feet, dt)
        fade = self._task.fade_speed
        self.weight = 1.0 if fade is None else 1.0 / (1.0 + (hypot(*self._velocity) / fade) ** 4)

    def _travel(self, feet: Sequence[Sequence[float]], dt: float) -> None:
        """Low-passed velocity of the middle of both feet, m/s; it stands still while only one of them is known."""
        before = self._middle
        if len(feet) < 2:
            self._middle = None
            return
        x, y = 0.5 * (feet[0][0] + feet[1][0]), 0.5 * (feet[0][1] + feet[1][1])
        self._middle = (x, y)
        if before is not None:
            share = 1.0 - exp(-dt / SPEED_SETTLE_S)
            vx, vy = self._velocity
            self._velocity = (
                vx + share * ((x - before[0]) / dt - vx),
                vy + share * ((y - before[1]) / dt - vy),
            )
