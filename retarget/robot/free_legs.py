"""Free legs: a robot without ground contact follows the performer's path, for viewers and training.

Its world is the performer's, scaled by the length of the legs, and its lower ankle has the performer's height.
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
"""Weight of a swing foot, which may lag without pulling pelvis or stance foot."""
CARRY_S = 0.05
"""Time constant of these weights, s."""
SPOT = 0.05
"""Distance of the performer's foot, relative to the leg, up to which a stance foot stays on its spot."""
SPOT_S = 0.1
"""Time constant with which a lifted foot leaves its spot, s."""


@dataclass(frozen=True)
class FreeFoot:
    """Landmark of a sole: row, frame, side (0 left, 1 right), and offset from the ankle, m, in its frame."""

    row: int
    frame: str
    side: int
    offset: Vector


class FreeLegs:
    """Pelvis and feet of one robot with free legs."""

    def __init__(
        self, feet: Sequence[FreeFoot], scale: float, dimensions: HumanDimensions, rest: Mapping[str, FloatArray]
    ) -> None:
        """feet: left, right. scale: robot's leg to performer's. rest: places (3,) m of joints, standing."""
        self.feet = tuple(feet)
        hips = {"l_hip": 0.5 * scale, "r_hip": 0.5 * scale}
        self.sums: tuple[dict[str, float], ...] = (hips, {"l_ankle": scale}, {"r_ankle": scale})
        """The middle of the hips, and both ankles, as scaled sums of joints."""
        self._ankle = scale * FRACTIONS.ankle_height * dimensions.stature
        self._spot = SPOT * scale * (rest["l_hip"][2] - rest["l_ankle"][2])
        lines = [as_vector(rest[f"{side}_toe"] - rest[f"{side}_ankle"]) for side in SIDES]
        self._rest = [_direction(line) for line in lines]
        self.restart()

    def restart(self) -> None:
        """Start at the origin, on both feet."""
        self._begin: tuple[float, float] | None = None
        self._weights = [1.0, 1.0]
        self._aside = [(0.0, 0.0), (0.0, 0.0)]
        self._spots: list[tuple[float, float] | None] = [None, None]

    def place(self, point: Vector) -> Vector:
        """Scaled point of the performer, m, from where they began."""
        x, y, z = point
        if self._begin is None:
            self._begin = (x, y)
        return x - self._begin[0], y - self._begin[1], z

    def spots(self, desired: Sequence[Vector], carrying: Carrying, dt: float) -> list[Vector]:
        """Places of both soles, m, `dt` s later."""
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
        """Orientations of both soles. lines: from ankle to toe."""
        found = []
        for line, (rest_yaw, rest_pitch) in zip(lines, self._rest, strict=True):
            yaw, pitch = _direction(line)
            found.append(product(axis_turn(UP, yaw - rest_yaw), axis_turn(LEFT, rest_pitch - pitch)))
        return tuple(found)

    def weights(self, carrying: Carrying, dt: float) -> tuple[float, ...]:
        """Weights of both soles `dt` s later."""
        for side, carries in enumerate(carrying.feet):
            self._weights[side] = low_pass(self._weights[side], 1.0 if carries else SWING, dt / CARRY_S)
        return tuple(self._weights)

    def lift(self, landmarks: Sequence[Vector], turns: Sequence[Quat], ankles: Sequence[Vector]) -> float:
        """Height, m, by which to raise all landmarks for the performer's height of ankles."""
        needed = []
        for foot in self.feet:
            ankle = minus(landmarks[foot.row], rotated(turns[foot.side], foot.offset))
            above = max(ankles[foot.side][2] - self._ankle, 0.0)
            needed.append(above - foot.offset[2] - ankle[2])
        return max(needed)


def _direction(line: Vector) -> tuple[float, float]:
    x, y, z = line
    across = hypot(x, y)
    return (arctan2(y, x) if across > 0.0 else 0.0), arctan2(z, across)
