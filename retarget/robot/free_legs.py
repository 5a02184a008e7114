"""Free legs: a robot that nothing carries goes where its performer goes, as a viewer or a trainer wants it.

The robot's world is then the performer's, scaled by the length of the legs, with the origin where they begin and x
where they face then. The pelvis is over the ground as theirs is, and feet by the length of the legs from it. Legs of
robot and performer have other hips and ankles, so that soles would sink or hover: the whole body is raised or lowered
until the lower ankle is as high above its height in the stance as theirs is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from retarget.arithmetic import arctan2, hypot, low_pass
from retarget.model.human_dimensions import FRACTIONS, HumanDimensions
from retarget.rotations import Quat, Vector, as_vector, axis_turn, minus, product, rotated
from retarget.types import Carrying, FloatArray

LEFT, UP = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
"""Unit vectors in the robot's world."""
SIDES = ("l", "r")
SWING = 0.3
"""Weight of a sole that does not carry: a swing foot may lag without pulling the pelvis or the stance foot."""
CARRY_S = 0.05
"""Time constant (s) with which a sole takes the other weight."""
SPOT = 0.05
"""A foot that carries stays on its spot as long as the performer's is within so many lengths of the robot's leg from
there. An ankle that rolls over its toes gets 0.15 far; a foot that waits until then has to hurry, and the legs lag."""
SPOT_S = 0.1
"""Time constant (s) with which a foot that no longer carries gets to where the performer's is."""


@dataclass(frozen=True)
class FreeFoot:
    """A landmark that is a sole. row: of the landmarks; frame: its name; side: 0 left, 1 right; offset: the sole from
    the ankle, m, in its own frame."""

    row: int
    frame: str
    side: int
    offset: Vector


class FreeLegs:
    """Pelvis and feet of one robot that goes where its performer does."""

    def __init__(
        self, feet: Sequence[FreeFoot], scale: float, dimensions: HumanDimensions, rest: Mapping[str, FloatArray]
    ) -> None:
        """feet: left, right. scale: of the robot's leg over the performer's. rest: place (3,) m of each joint, standing
        upright."""
        self.feet = tuple(feet)
        hips = {"l_hip": 0.5 * scale, "r_hip": 0.5 * scale}
        self.sums: tuple[dict[str, float], ...] = (hips, {"l_ankle": scale}, {"r_ankle": scale})
        """The middle of the hips and both ankles, as sums of the performer's joints, in the robot's size."""
        self._ankle = scale * FRACTIONS.ankle_height * dimensions.stature
        self._spot = SPOT * scale * (rest["l_hip"][2] - rest["l_ankle"][2])
        lines = [as_vector(rest[f"{side}_toe"] - rest[f"{side}_ankle"]) for side in SIDES]
        self._rest = [_direction(line) for line in lines]
        self.restart()

    def restart(self) -> None:
        """Begin at the origin, on both feet."""
        self._begin: tuple[float, float] | None = None
        self._weights = [1.0, 1.0]
        self._aside = [(0.0, 0.0), (0.0, 0.0)]
        self._spots: list[tuple[float, float] | None] = [None, None]

    def place(self, point: Vector) -> Vector:
        """A point of the performer, m, in the robot's size, from where the middle of their hips began."""
        x, y, z = point
        if self._begin is None:
            self._begin = (x, y)
        return x - self._begin[0], y - self._begin[1], z

    def spots(self, desired: Sequence[Vector], carrying: Carrying, dt: float) -> list[Vector]:
        """Where left and right sole are to be, m, `dt` s later. desired: where they are to be without spots."""
        spots = []
        for foot, ((x, y, z), carries) in enumerate(zip(desired, carrying.feet, strict=True)):
            if carries:
                spot_x, spot_y = self._spots[foot] or (x, y)
                aside_x, aside_y = spot_x - x, spot_y - y
                share = self._spot / max(hypot(aside_x, aside_y), self._spot)
            else:
                (aside_x, aside_y), share = self._aside[foot], low_pass(1.0, 0.0, dt / SPOT_S)
            aside_x, aside_y = share * aside_x, share * aside_y
            self._aside[foot], self._spots[foot] = (aside_x, aside_y), (x + aside_x, y + aside_y)
            spots.append((x + aside_x, y + aside_y, z))
        return spots

    def turns(self, lines: Sequence[Vector]) -> tuple[Quat, ...]:
        """Orientations of both soles: flat and forward where the performer's feet are as at rest. lines: from ankles to
        toes."""
        found = []
        for line, (rest_yaw, rest_pitch) in zip(lines, self._rest, strict=True):
            yaw, pitch = _direction(line)
            found.append(product(axis_turn(UP, yaw - rest_yaw), axis_turn(LEFT, rest_pitch - pitch)))
        return tuple(found)

    def weights(self, carrying: Carrying, dt: float) -> tuple[float, ...]:
        """Weights of the places of both soles `dt` s later: one that stands does not slide."""
        for side, carries in enumerate(carrying.feet):
            self._weights[side] = low_pass(self._weights[side], 1.0 if carries else SWING, dt / CARRY_S)
        return tuple(self._weights)

    def lift(self, landmarks: Sequence[Vector], turns: Sequence[Quat], ankles: Sequence[Vector]) -> float:
        """How far up all landmarks go, m, so that no ankle is lower than the performer's. ankles: theirs."""
        needed = []
        for foot in self.feet:
            ankle = minus(landmarks[foot.row], rotated(turns[foot.side], foot.offset))
            above = max(ankles[foot.side][2] - self._ankle, 0.0)
            needed.append(above - foot.offset[2] - ankle[2])
        return max(needed)


def _direction(line: Vector) -> tuple[float, float]:
    """Yaw and pitch, rad, of a line; upwards is positive."""
    x, y, z = line
    across = hypot(x, y)
    return (arctan2(y, x) if across > 0.0 else 0.0), arctan2(z, across)
