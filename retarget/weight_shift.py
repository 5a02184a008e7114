"""The way of a centre of mass from over one place to over another, no faster than what carries can push it.

It is pushed by the zero-moment point being beside it: to speed up, behind it, to brake, ahead. Where that would leave
the region that carries, it speeds up or brakes less across that edge.
"""

import numpy as np

from retarget.glide import Glide
from retarget.rotations import FloatArray
from retarget.standing_balance import GRAVITY, Edges

__all__ = ["WeightShift"]

ROOM_SHARE = 0.7
"""Share of the room around a place that the zero-moment point uses on the way to it."""
SPEED = 0.15
"""m/s along each axis."""


class WeightShift:
    """`at`: where the centre of mass is to be, x and y, m. It starts at rest."""

    def __init__(self, *, room: float, height: float) -> None:
        """room: of the zero-moment point around where the way ends, m. height: of the centre of mass, m."""
        self._lever = height / GRAVITY
        self._glide = Glide((0.0, 0.0), acceleration=ROOM_SHARE * room / self._lever, speed=SPEED)

    @property
    def at(self) -> list[float]:
        """Where the centre of mass is to be, m."""
        return self._glide.at

    def restart(self, com: FloatArray, velocity: FloatArray, dt: float) -> None:
        """Go on from a centre of mass (3,) m that moves at velocity (3,) m/s, in ticks of `dt` s."""
        self._glide.restart(com[:2].tolist(), (velocity[:2] * dt).tolist())

    def step(self, goal: FloatArray, region: Edges, dt: float) -> FloatArray:
        """Where it is to be (2,) m `dt` s later, on its way to a goal (2,) m. region: of its zero-moment point."""
        before, moved = np.array(self._glide.at), np.array(self._glide.moved)
        after = np.array(self._glide.step(goal.tolist(), dt))
        push = (after - before - moved) / (dt * dt) * self._lever  # (2,) [m] that the zero-moment point is behind
        held = push.copy()
        for nx, ny, offset in region:
            # p = c - push; n . p <= offset
            beyond = nx * float(before[0] - held[0]) + ny * float(before[1] - held[1]) - offset
            if beyond > 0.0 and nx * float(held[0]) + ny * float(held[1]) < 0.0:
                held += min(beyond, -nx * float(held[0]) - ny * float(held[1])) * np.array([nx, ny])
        if (held != push).any():
            slower = moved + held * (dt * dt / self._lever)
            after = before + slower
            self._glide.restart(after.tolist(), slower.tolist())
        return after
