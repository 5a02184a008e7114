"""Where the centre of mass of a robot on its soles may be after the next tick, so that it stays on them.

At rest a robot stands while its centre of mass is over the support polygon. With mass in motion it stands while its
zero-moment point (M. Vukobratovic and B. Borovac, Int. J. Humanoid Robotics 1(1), 2004) is in there: with the mass in
one point c at height z,

    p = c - z / (g + z'') * c''

To stay able to stop, its capture point c + c' / sqrt(g / z) (J. Pratt et al., Humanoids 2006) is kept in there as well:
from there it can be stopped with the zero-moment point inside. Both are half-spaces for the centre of mass after the
tick, which the hierarchy keeps like any others: where more is asked, the robot lags.
"""

from math import sqrt

import numpy as np

from retarget.priorities import CentreOfMassTask, Priorities
from retarget.pursuit import braking_displacement
from retarget.rotations import FloatArray
from retarget.stance import Stance

__all__ = ["GRAVITY", "Edges", "StandingBalance", "moving_spaces", "shrunk"]

BRAKING = 1.0
"""Deceleration (m/s^2) with which the centre of mass can surely be stopped before the edge of the support polygon."""
WIDER = 1.4
"""Share of the room of a mass in motion through which one comes back that was stopped at its edge."""
GRAVITY = 9.81
"""m/s^2"""

Edges = list[list[float]]


class StandingBalance:
    """What the `support` tasks of priorities ask of a robot in a stance. `edges` (e, 3): of the support polygon, drawn
    in by their margin. `looks_at_motion`: whether the velocity of the centre of mass counts."""

    def __init__(self, priorities: Priorities, stance: Stance) -> None:
        tasks = [task for _, _, task in priorities.tasks() if isinstance(task, CentreOfMassTask)]
        self.edges = stance.edges(max((task.margin for task in tasks), default=0.0))
        self._outline: Edges = stance.edges(0.0).tolist()
        self._drawn_in: Edges = self.edges.tolist()
        share = min((task.moving for task in tasks if task.moving is not None), default=None)
        self.looks_at_motion = share is not None
        self._room: Edges = [] if share is None else shrunk(self.edges, share, stance).tolist()
        wider = None if share is None else min(WIDER * share, 1.0)
        self._wide: Edges = [] if wider is None else shrunk(self.edges, wider, stance).tolist()
        self.comes_back = False
        """Whether it was stopped, perhaps outside of its room, and has a wider one to come back through."""

    def spaces(self, com: FloatArray, velocity: FloatArray, dt: float) -> FloatArray:
        """Half-spaces (k, 4) for the centre of mass after the next `dt` s, now at com (3,) m, moving at velocity (3,)
        m/s."""
        if not self.looks_at_motion:
            return _braked(self._drawn_in, com, dt)
        return moving_spaces(self._wide if self.comes_back else self._room, com, velocity, dt)

    def holds(self, com: FloatArray) -> bool:
        """Whether a centre of mass (3,) m at rest is in the wider room. From elsewhere no pressure in there brings it
        back."""
        x, y, _ = com.tolist()
        return all(nx * x + ny * y <= offset for nx, ny, offset in self._wide)

    def inside(self, com: FloatArray) -> float:
        """How far (m) a centre of mass (3,) is inside the soles' outline."""
        x, y, _ = com.tolist()
        return float(min(offset - nx * x - ny * y for nx, ny, offset in self._outline))


def shrunk(edges: FloatArray, share: float, stance: Stance) -> FloatArray:
    """Edges (e, 3) of the polygon at a share of its size about the middle of the soles."""
    middle = np.concatenate([sole.outline for sole in stance.soles]).mean(axis=0)
    at = edges[:, :2] @ middle
    return np.column_stack([edges[:, :2], at + share * (edges[:, 2] - at)])


def _braked(edges: Edges, com: FloatArray, dt: float) -> FloatArray:
    """Edges drawn in to what the centre of mass may do in one tick and still stop inside of them."""
    x, y, _ = com.tolist()
    change = BRAKING * dt * dt
    drawn = []
    for nx, ny, offset in edges:
        across = nx * x + ny * y
        drawn.append((nx, ny, 0.0, across + braking_displacement(offset - across, change)))
    return np.array(drawn)


def moving_spaces(edges: Edges, com: FloatArray, velocity: FloatArray, dt: float) -> FloatArray:
    """Capture point and zero-moment point inside of edges."""
    x, y, z = com.tolist()
    vx, vy, vz = velocity.tolist()
    settle = sqrt(z / GRAVITY) / dt
    rows = []
    for nx, ny, offset in edges:
        at, speed = nx * x + ny * y, nx * vx + ny * vy
        rows.append((nx, ny, 0.0, (offset + settle * at) / (1.0 + settle)))
        # (n.c - d)(g + z'') <= z n.c'', times dt^2 / z, with n.c and z as they are now
        lever = (at - offset) / z
        rows.append((-nx, -ny, lever, lever * (z + vz * dt - GRAVITY * dt * dt) - at - speed * dt))
    return np.array(rows)
