"""How fast to go after what is asked, so that whatever happens the robot arrives without overshoot.

A solver that corrects all of an error at once, within the acceleration of its joints, arrives too fast to stop there
and swings about the goal. Here the step of a tick is the asked motion's own, as far as it is smooth, and beside it no
more than can be braked: v = sqrt(2 a gap). A motion within the limits is followed without any lag. A jump is neither
taken for motion nor followed at once: it is caught up with.
"""

from dataclasses import dataclass

import numpy as np

from retarget.rotations import FloatArray

__all__ = ["Pace", "Pursuit"]


@dataclass(frozen=True, eq=False)
class Pace:
    """Limits per channel, each (c,), in m or rad. own: greatest change of the asked motion that is believed, per s^2.

    catch_up: acceleration and braking of the way to what is asked, per s^2; speed: greatest speed of it, per s.
    """

    own: FloatArray
    catch_up: FloatArray
    speed: FloatArray


class Pursuit:
    """Steps for c channels, each a vector of three: points, or rotations as rotation vectors."""

    def __init__(self, pace: Pace) -> None:
        self._pace = pace
        self._own = np.zeros((len(pace.own), 3))
        self._before = np.zeros(len(pace.own))

    def restart(self) -> None:
        """Start at rest, after something that stands still."""
        self._own[:] = 0.0
        self._before[:] = 0.0

    def step(self, moved: FloatArray, error: FloatArray, dt: float, *, haste: float = 1.0) -> FloatArray:
        """Displacement (c, 3) to ask for in this tick of `dt` s.

        moved (c, 3): how far what is asked moved since the last tick. error (c, 3): from where the robot is to what is
        asked now. haste: share of the catching-up speed.
        """
        pace = self._pace
        change = moved / dt - self._own
        self._own += change * np.minimum(1.0, pace.own * dt / np.maximum(lengths(change), 1e-12))[:, None]
        own = self._own * dt
        rest = error - own
        gap = lengths(rest)
        step = pace.catch_up * (dt * dt)
        ahead = np.minimum(braking_displacement(gap, step), self._before + step)
        np.minimum(ahead, pace.speed * (haste * dt), out=ahead)
        self._before = ahead
        return np.asarray(own + rest * (ahead / np.maximum(gap, 1e-12))[:, None])


def lengths(vectors: FloatArray) -> FloatArray:
    """Lengths (c,) of vectors (c, 3)."""
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)))


def braking_displacement(gap: FloatArray, change: FloatArray | float) -> FloatArray:
    """Largest displacement x of a tick for which x + (x - change) + ... down to zero covers no more than `gap`."""
    ticks = np.floor(0.5 * (np.sqrt(1.0 + 8.0 * np.maximum(gap, 0.0) / change) - 1.0))
    return np.asarray((gap + 0.5 * change * ticks * (ticks + 1.0)) / (ticks + 1.0))
