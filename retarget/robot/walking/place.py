"""Where the stance of a robot is in the world: on the floor, turned about the vertical."""

from dataclasses import dataclass, replace

import numpy as np

from retarget.arithmetic import cos, sin
from retarget.ik.support_polygon import Sole, Stance
from retarget.robot.landmarks import UP
from retarget.robot.walking.pattern import Foothold
from retarget.rotations import Quat, Vector, as_quat, as_vector, axis_turn, product, rotated
from retarget.types import FloatArray


@dataclass(frozen=True)
class StancePlace:
    """x, y m; yaw rad. At the origin, a posture is the same object in both worlds."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    @property
    def is_origin(self) -> bool:
        """Whether it has not moved."""
        return self == StancePlace()

    @property
    def turn(self) -> Quat:
        """Its orientation wxyz."""
        return axis_turn(UP, self.yaw)

    @property
    def inverse(self) -> "StancePlace":
        """The origin, as seen from here."""
        x, y, _ = rotated(axis_turn(UP, -self.yaw), (-self.x, -self.y, 0.0))
        return StancePlace(x, y, -self.yaw)

    def point(self, local: Vector) -> Vector:
        """A point, m, of the stance's world in the world."""
        x, y, z = rotated(self.turn, local)
        return self.x + x, self.y + y, z

    def points(self, local: FloatArray) -> FloatArray:
        """Points (..., 3) m of the stance's world in the world."""
        c, s = cos(self.yaw), sin(self.yaw)
        x, y, z = np.moveaxis(local, -1, 0)
        return np.stack([self.x + c * x - s * y, self.y + s * x + c * y, z], axis=-1)

    def postures(self, q: FloatArray) -> FloatArray:
        """Postures (k, nq) of the stance's world in the world."""
        moved = q.copy()
        moved[:, :3] = self.points(q[:, :3])
        for row in moved:
            row[3:7] = product(self.turn, as_quat(row[3:7]))
        return moved

    def velocity(self, local: FloatArray) -> FloatArray:
        """A velocity (nv,), root first, of the stance's world in the world."""
        moved = local.copy()
        moved[:3] = rotated(self.turn, as_vector(local[:3]))
        return moved


def place_of(stance: Stance, feet: tuple[Foothold, Foothold]) -> StancePlace:
    """Where a stance is whose soles have their middles on these footholds."""
    middle = 0.5 * (feet[0].place + feet[1].place)
    yaw = 0.5 * (feet[0].yaw + feet[1].yaw)
    own = 0.5 * (stance.soles[0].outline.mean(axis=0) + stance.soles[1].outline.mean(axis=0))
    x, y, _ = StancePlace(yaw=yaw).point((float(own[0]), float(own[1]), 0.0))
    return StancePlace(float(middle[0]) - x, float(middle[1]) - y, yaw)


def soles_at(stance: Stance, place: StancePlace) -> list[Sole]:
    """The soles of a stance that is elsewhere."""
    return [
        replace(
            sole,
            position=np.array(place.point(as_vector(sole.position))),
            orientation=np.array(product(place.turn, as_quat(sole.orientation))),
            outline=place.points(np.insert(sole.outline, 2, 0.0, axis=1))[:, :2],
        )
        for sole in stance.soles
    ]
