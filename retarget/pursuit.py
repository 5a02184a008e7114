"""How fast to go after what is asked, so that whatever happens the robot arrives without overshoot.

A solver that corrects all of an error at once, within the acceleration of its joints, arrives too fast to stop there
and swings about the goal. Here the step of a tick is the asked motion's own, as far as it is smooth, and beside it no
more than can be braked: v = sqrt(2 a gap). A motion within the limits is followed without any lag. A jump is neither
taken for motion nor followed at once: it is caught up with.
"""

from dataclasses import dataclass
from math import exp, floor, sqrt

from retarget.scalar_rotations import Vector

__all__ = ["Pace", "Pursuit", "braking_displacement"]

SMOOTH_S = 0.04
"""Time constant (s) of the asked motion's own velocity: shorter is noise. What this lags behind is caught up with."""
RATE = 30.0
"""Share of what is left that is caught up with, per s, where braking does not matter: the gain that noise meets."""
STILL = 1e-12


@dataclass(frozen=True)
class Pace:
    """Limits of a channel, in m or rad. own: greatest acceleration of the asked motion that is believed, per s^2.

    catch_up: acceleration and braking of the way to what is asked, per s^2; speed: greatest speed of it, per s.
    """

    own: float
    catch_up: float
    speed: float


class Pursuit:
    """Steps of one channel, a vector of three: a point, or a rotation as rotation vectors."""

    def __init__(self, pace: Pace, *, ahead: float = 0.0) -> None:
        """ahead: s; it aims at where the motion will be then, if it keeps its own velocity."""
        self._pace, self._ahead = pace, ahead
        self._own: Vector = (0.0, 0.0, 0.0)
        self._before = 0.0

    def restart(self) -> None:
        """Start at rest, after something that stands still."""
        self._own = (0.0, 0.0, 0.0)
        self._before = 0.0

    def step(self, moved: Vector, error: Vector, dt: float, *, haste: float = 1.0) -> Vector:
        """Displacement to ask for in this tick of `dt` s.

        moved: how far what is asked moved since the last tick. error: from where the robot is to what is asked now.
        haste: share of the catching-up speed and acceleration.
        """
        pace = self._pace
        ox, oy, oz = self._own
        share = 1.0 - exp(-dt / SMOOTH_S)
        cx, cy, cz = share * (moved[0] / dt - ox), share * (moved[1] / dt - oy), share * (moved[2] / dt - oz)
        scale = min(1.0, pace.own * dt / max(sqrt(cx * cx + cy * cy + cz * cz), STILL))
        ox, oy, oz = self._own = (ox + scale * cx, oy + scale * cy, oz + scale * cz)

        a = self._ahead
        ex, ey, ez = error[0] + a * ox, error[1] + a * oy, error[2] + a * oz
        ox, oy, oz = ox * dt, oy * dt, oz * dt
        rx, ry, rz = ex - ox, ey - oy, ez - oz
        gap = sqrt(rx * rx + ry * ry + rz * rz)
        change = pace.catch_up * haste * dt * dt
        ahead = min(braking_displacement(gap, change), self._before + change)
        self._before = ahead = min(ahead, pace.speed * haste * dt, gap * min(1.0, RATE * dt))
        share = ahead / max(gap, STILL)
        return ox + share * rx, oy + share * ry, oz + share * rz


def braking_displacement(gap: float, change: float) -> float:
    """Largest displacement x of a tick for which x + (x - change) + ... down to zero covers no more than `gap`."""
    ticks = floor(0.5 * (sqrt(1.0 + 8.0 * max(gap, 0.0) / change) - 1.0))
    return (gap + 0.5 * change * ticks * (ticks + 1.0)) / (ticks + 1.0)
