"""Posture prior: what is natural where no sensor measures it: balance, a crouch by the height of the head, and feet.

A standing body is in balance when its centre of mass is over the feet that carry it; the faster it travels, the less
that holds, so the weight of this goal falls with speed. The speed is that of the feet: a crouch moves the head, and
changes nothing here.
"""

from collections.abc import Sequence
from math import exp, hypot

import numpy as np

from retarget.model.human import Human, PostureReader
from retarget.model.human_dimensions import FRACTIONS, POINTS, HumanDimensions
from retarget.schema.priorities import CentreOfMassTask
from retarget.types import FloatArray

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
        """Start at rest, without a past."""
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


# Crouch: the natural posture for a height of the head, from upright to a deep crouch.
#
# Hips, knees and the lumbar spine bend together when a person gets down. With one reference posture for all heights,
# the stiffness of single joints would decide how; the spine, stiff while standing, would then hardly bend at all.


class Crouch:
    """Between two postures of the human, by how high the head is above the feet."""

    def __init__(self, human: Human, *, upright: str, lowered: str) -> None:
        postures = np.stack([human.posture(upright), human.posture(lowered)])
        self._upright = postures[0]
        self._change = postures[1] - postures[0]
        joints = PostureReader(human).joints(postures)
        ankles = [POINTS.index("l_ankle"), POINTS.index("r_ankle")]
        heights = joints[:, POINTS.index("head"), 2] - joints[:, ankles, 2].mean(axis=1)
        self._high, self._low = float(heights[0]), float(heights[1])

    def share(self, height: float) -> float:
        """How much of the crouch belongs to a head `height` m above the ankles: 0 upright, 1 lowered."""
        return min(max((self._high - height) / (self._high - self._low), 0.0), 1.0)

    def posture(self, height: float) -> FloatArray:
        """The posture (nq,) that is natural with the head `height` m above the ankles."""
        return np.asarray(self._upright + self.share(height) * self._change)


# Virtual feet of a performer without ankle sensors: planted, on the ground, following the head.
#
# With a head and two hands nothing measures the legs. The feet stay where they are while the head moves above them, and
# glide after it once it would leave them behind; in a crouch the head may be further forward.

HEAD_LEAD_M = (0.03, 0.40)
"""How far the head is forward of the ankles, upright and in a deep crouch."""
REACH_M = 0.12
"""How far the head may wander from there before the feet follow."""
GLIDE_S = 0.15
"""Time constant with which the feet follow."""


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
