"""Where the sole goes that carries nothing: after the performer's foot, within bounds, and back to its place."""

from retarget.glide import Glide
from retarget.rotations import FloatArray
from retarget.scalar_rotations import Vector

__all__ = ["SwingFoot"]

LOW, HIGH = 0.06, 0.18
"""How high a lifted sole is at least and at most, as shares of the length of the leg."""
WAY = 0.14
"""How far it goes from above its place at most, as a share of the length of the leg; never towards the other foot."""
CLEAR = 0.7
"""Share of the least height from which on it goes anywhere but up."""
ACCELERATION, SPEED = 0.5, 0.1
"""m/s^2 and m/s along each axis: slow enough that its mass asks for little balance."""
DOWNWARD = 0.4
"""Share of that speed at which it is put down."""
ABOVE_M = 0.001
"""So near to its place it may come down."""


class SwingFoot:
    """The way of one sole's centre, world frame. It begins and ends where it is planted, flat."""

    def __init__(self, place: FloatArray, *, outward: float, leg: float) -> None:
        """place (3,) m: where it is planted. outward: 1 for a left foot, -1 for a right one. leg: its length, m."""
        x, y, z = place.tolist()
        self._place: Vector = (x, y, z)
        self._outward, self._low, self._high, self._way = outward, LOW * leg, HIGH * leg, WAY * leg
        self._glide = Glide(self._place, acceleration=ACCELERATION, speed=SPEED)

    def restart(self, at: list[float]) -> None:
        """Go on at rest from a point, m."""
        self._glide.restart(at)

    @property
    def at(self) -> list[float]:
        """Where the sole is to be, m."""
        return self._glide.at

    def follow(self, offset: Vector, dt: float) -> list[float]:
        """Where it is to be `dt` s later, on its way to an offset from its place, m."""
        x, y, z = self._place
        ahead, aside, up = offset
        goal = [x, y, z + min(max(up, self._low), self._high)]
        if self.at[2] - z > CLEAR * self._low:
            goal[0] += min(max(ahead, -self._way), self._way)
            goal[1] += self._outward * min(max(self._outward * aside, 0.0), self._way)
        return self._glide.step(goal, dt)

    def lower(self, dt: float) -> list[float]:
        """Where it is to be `dt` s later, on its way down to its place: first above it, then straight down."""
        x, y, z = self._place
        off = max(abs(self.at[0] - x), abs(self.at[1] - y))
        height = z if off < ABOVE_M else z + self._low
        return self._glide.step((x, y, height), dt, haste=DOWNWARD if off < ABOVE_M else 1.0)
