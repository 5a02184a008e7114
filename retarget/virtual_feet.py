"""Where the feet are taken to be when nobody wears ankle sensors: planted, on the ground, following the head.

With a head and two hands nothing tells what the legs do. The feet stay where they are while the head moves above them,
and glide after it once it would leave them behind; in a crouch the head may be further ahead.
"""

from math import exp, hypot

import numpy as np

from retarget.anthropometry import FRACTIONS
from retarget.human_dimensions import HumanDimensions
from retarget.rotations import FloatArray

__all__ = ["VirtualFeet"]

Ground = tuple[float, float]

HEAD_LEAD_M = (0.03, 0.40)
"""How far ahead of the ankles the head is, upright and in a deep crouch."""
REACH_M = 0.12
"""How far the head may wander from there before the feet follow."""
GLIDE_S = 0.15
"""Time constant with which they do."""


class VirtualFeet:
    """`ankles` (2, 3) m, left and right, world frame."""

    def __init__(self, dimensions: HumanDimensions) -> None:
        self._half_width = 0.5 * float(dimensions.of("l_hip")[1] - dimensions.of("r_hip")[1])
        self.ankle_height = FRACTIONS.ankle_height * dimensions.stature
        self._middle: Ground | None = None
        self.ankles: FloatArray = np.zeros((2, 3))

    def start(self, head: list[float], forward: Ground, *, crouch: float) -> None:
        """Stand under the head. Arguments as of `step`."""
        self._middle = self._below(head, forward, crouch)
        self._place(forward)

    def step(self, head: list[float], forward: Ground, *, crouch: float, dt: float) -> None:
        """Go on by `dt` seconds. head: x, y, z m. forward: the heading. crouch: how lowered the head is, 0 to 1."""
        if self._middle is None:
            self.start(head, forward, crouch=crouch)
            return
        below = self._below(head, forward, crouch)
        dx, dy = below[0] - self._middle[0], below[1] - self._middle[1]
        distance = hypot(dx, dy)
        if distance > REACH_M:
            share = (1.0 - exp(-dt / GLIDE_S)) * (distance - REACH_M) / distance
            self._middle = (self._middle[0] + share * dx, self._middle[1] + share * dy)
        self._place(forward)

    def _below(self, head: list[float], forward: Ground, crouch: float) -> Ground:
        lead = HEAD_LEAD_M[0] + crouch * (HEAD_LEAD_M[1] - HEAD_LEAD_M[0])
        return head[0] - lead * forward[0], head[1] - lead * forward[1]

    def _place(self, forward: Ground) -> None:
        assert self._middle is not None
        aside = (-self._half_width * forward[1], self._half_width * forward[0])
        x, y = self._middle
        self.ankles[0] = x + aside[0], y + aside[1], self.ankle_height
        self.ankles[1] = x - aside[0], y - aside[1], self.ankle_height
