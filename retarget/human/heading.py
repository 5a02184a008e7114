"""Heading: where a performer faces, from a few sensors.

One hint is not enough: the line between the ankles alone is wrong by 69 degrees on average while walking. So several
are summed, each a vector on the ground, and the sum is low-passed: lines between left and right, hands that work in
front of the body, the direction in which the head moves, and axes of sensors with an orientation.
"""

from collections.abc import Mapping, Sequence
from math import exp, hypot

from retarget.schema.priorities import HeadingSettings

_NO_HINT_M = 0.01
"""A sum shorter than this gives no direction: the last heading stays."""

Point = Sequence[float]
Ground = tuple[float, float]


class Heading:
    """The low-passed heading. `forward` (x, y) is a unit vector on the ground, world frame."""

    def __init__(self, settings: HeadingSettings) -> None:
        self._settings = settings
        self._sum: Ground = (0.0, 0.0)
        self._velocity: Ground = (0.0, 0.0)
        self._head: Ground | None = None
        self.forward: Ground = (1.0, 0.0)

    def start(self, positions: Mapping[str, Point], facing: Mapping[str, Ground]) -> None:
        """Take the heading of one instant, without any filtering. Arguments as of `step`."""
        self._velocity, self._head = (0.0, 0.0), None
        self._sum = self._hints(positions, facing)
        self._turn()

    def face(self, forward: Ground) -> None:
        """Take a heading from a better source than the hints."""
        length = hypot(*self._sum)
        self.forward = forward
        self._sum = (length * forward[0], length * forward[1])

    def step(self, positions: Mapping[str, Point], facing: Mapping[str, Ground], *, dt: float) -> None:
        """Go on by `dt` seconds.

        positions: x, y (and z) m by sensor, valid ones only. facing: forward axes (x, y) of sensors with an
        orientation, shorter than one where they point up or down.
        """
        self._move(positions.get("head"), dt)
        share = 1.0 - exp(-dt / self._settings.settle)
        x, y = self._hints(positions, facing)
        self._sum = (self._sum[0] + share * (x - self._sum[0]), self._sum[1] + share * (y - self._sum[1]))
        self._turn()

    def _hints(self, positions: Mapping[str, Point], facing: Mapping[str, Ground]) -> Ground:
        """Weighted sum of all hints, forward."""
        settings = self._settings
        x = y = 0.0
        for part, weight in settings.pairs.items():
            left, right = positions.get("l_" + part), positions.get("r_" + part)
            if left is not None and right is not None:
                x += weight * (left[1] - right[1])
                y -= weight * (left[0] - right[0])
        for name, axis in facing.items():
            weight = settings.facing.get(name, 0.0)
            x += weight * axis[0]
            y += weight * axis[1]
        slow, fast = settings.walking
        weight = settings.velocity * min(max((hypot(*self._velocity) - slow) / (fast - slow), 0.0), 1.0)
        ahead = self._hands_ahead(positions)
        return (
            x + weight * self._velocity[0] + settings.hands * ahead[0],
            y + weight * self._velocity[1] + settings.hands * ahead[1],
        )

    def _hands_ahead(self, positions: Mapping[str, Point]) -> Ground:
        """From the middle of the ankles to that of the wrists, m."""
        try:
            hands = positions["l_wrist"], positions["r_wrist"]
            feet = positions["l_ankle"], positions["r_ankle"]
        except KeyError:
            return 0.0, 0.0
        return (
            0.5 * (hands[0][0] + hands[1][0] - feet[0][0] - feet[1][0]),
            0.5 * (hands[0][1] + hands[1][1] - feet[0][1] - feet[1][1]),
        )

    def _move(self, head: Point | None, dt: float) -> None:
        """Low-passed velocity of the head, m/s."""
        before, self._head = self._head, None if head is None else (head[0], head[1])
        if before is None or head is None:
            return
        share = 1.0 - exp(-dt / self._settings.velocity_settle)
        vx, vy = self._velocity
        self._velocity = (
            vx + share * ((head[0] - before[0]) / dt - vx),
            vy + share * ((head[1] - before[1]) / dt - vy),
        )

    def _turn(self) -> None:
        x, y = self._sum
        length = hypot(x, y)
        if length > _NO_HINT_M:
            self.forward = (x / length, y / length)
