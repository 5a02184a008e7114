"""Where the centre of mass of a robot on its soles may be after the next tick, so that it stays on them.

At rest a robot stands while its centre of mass is over the support polygon. With mass in motion it stands while its
zero-moment point (M. Vukobratovic and B. Borovac, Int. J. Humanoid Robotics 1(1), 2004) is in there: with the mass in
one point c at height z,

    p = c - z / (g + z'') * c''

To stay able to stop, its capture point c + c' / sqrt(g / z) (J. Pratt et al., Humanoids 2006) is kept in there as well:
from there it can be stopped with the zero-moment point inside. Both are half-spaces for the centre of mass after the
tick, which the hierarchy keeps like any others: where more is asked, the robot lags.

Who has got out of that room - a stop brakes as hard as servos can - could stand there for ever: there is no way back
in with the zero-moment point inside, for the mass is pushed in by pressing farther out. So from there the zero-moment
point may go as far again beyond the edge as the capture point is, and does: that brings it back in.
"""

from math import sqrt

import numpy as np

from retarget.priorities import CentreOfMassTask, Priorities
from retarget.pursuit import braking_displacement
from retarget.rotations import FloatArray
from retarget.stance import Stance

__all__ = ["BEYOND_M", "GRAVITY", "Edges", "StandingBalance", "moving_spaces", "shrunk"]

BRAKING = 1.0
"""Deceleration (m/s^2) with which the centre of mass can surely be stopped before the edge of the support polygon."""
GRAVITY = 9.81
"""m/s^2"""
BEYOND_M = 0.0003
"""How far (m) beyond an edge the capture point of a robot that follows may be by rounding: the way back is not asked
for."""
LANDING = 0.5
"""Share of the support polygon, about its middle, for a robot on its way to a stand. Who begins it at the edge of the
room in which it followed comes in from there only by pressing beyond that edge."""
SPARE = 0.5
"""Room that the zero-moment point has about where it pushes the capture point back in, in shares of how far that is
out."""

Edges = list[list[float]]
Row = tuple[float, float, float, float]


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
        self._room = _room(self.edges, share, stance)
        self._wide = _room(self.edges, None if share is None else max(share, LANDING), stance)

    def spaces(self, com: FloatArray, velocity: FloatArray, dt: float, *, lands: bool = False) -> FloatArray:
        """Half-spaces (k, 4) for the centre of mass after the next `dt` s, now at com (3,) m, moving at velocity (3,)
        m/s. lands: of a robot on its way to a stand."""
        if not self.looks_at_motion:
            return _braked(self._drawn_in, com, dt)
        return moving_spaces(self._wide if lands else self._room, com, velocity, dt, outer=self._drawn_in)

    def inside(self, com: FloatArray) -> float:
        """How far (m) a centre of mass (3,) is inside the soles' outline."""
        x, y, _ = com.tolist()
        return float(min(offset - nx * x - ny * y for nx, ny, offset in self._outline))


def _room(edges: FloatArray, share: float | None, stance: Stance) -> Edges:
    return [] if share is None else shrunk(edges, share, stance).tolist()


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


def moving_spaces(
    edges: Edges,
    com: FloatArray,
    velocity: FloatArray,
    dt: float,
    *,
    outer: Edges | None = None,
    pressed: Edges | None = None,
) -> FloatArray:
    """Capture point and zero-moment point inside of edges; pressed: inside of which the latter may be instead. outer:
    inside of which it brings the former back where that is out, None: it does not."""
    x, y, z = com.tolist()
    vx, vy, vz = velocity.tolist()
    settle = sqrt(z / GRAVITY) / dt
    capture = (x + settle * dt * vx, y + settle * dt * vy)
    push = None if outer is None else _pushed_back(edges, outer, capture)

    def captured(nx: float, ny: float, offset: float) -> Row:
        at, speed = nx * x + ny * y, nx * vx + ny * vy
        inside = (offset + settle * at) / (1.0 + settle)
        if push is not None and nx * capture[0] + ny * capture[1] > offset:
            inside = max(inside, at + speed * dt + GRAVITY / z * (at - (nx * push[0] + ny * push[1])) * dt * dt)
        return nx, ny, 0.0, inside

    def borne(nx: float, ny: float, offset: float) -> Row:
        at, speed = nx * x + ny * y, nx * vx + ny * vy
        if push is not None:
            offset = max(offset, nx * push[0] + ny * push[1] + push[2])
        # (n.c - d)(g + z'') <= z n.c'', times dt^2 / z, with n.c and z as they are now
        lever = (at - offset) / z
        return -nx, -ny, lever, lever * (z + vz * dt - GRAVITY * dt * dt) - at - speed * dt

    if pressed is None:
        return np.array([row(*edge) for edge in edges for row in (captured, borne)])
    return np.array([*(captured(*edge) for edge in edges), *(borne(*edge) for edge in pressed)])


def _pushed_back(edges: Edges, outer: Edges, capture: tuple[float, float]) -> tuple[float, float, float] | None:
    """Zero-moment point (x, y) m that brings back a capture point beyond an edge, and what it may be off; None: it is
    inside.

    As far beyond as the capture point again, but inside of outer: so that falls as exp(-t / sqrt(z / g)).
    """
    x, y = capture
    beyond, nx, ny = max((ex * x + ey * y - offset, ex, ey) for ex, ey, offset in edges)
    if beyond <= BEYOND_M:
        return None
    way = beyond
    for ex, ey, offset in outer:
        along = ex * nx + ey * ny
        if along > 0.0:
            way = min(way, max(offset - ex * x - ey * y, 0.0) / along)
    return x + way * nx, y + way * ny, SPARE * way
