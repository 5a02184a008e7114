"""Whether a robot can stand in its posture `stand`: its centre of mass over the polygon of its soles."""

import numpy as np

from retarget.errors import ConfigError
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from retarget.stance import plant
from retarget.support import convex_hull, support_distance

__all__ = ["check_stand"]

MM = 1e3


def check_stand(robot: RobotBody) -> float | None:
    """How far, m, the centre of mass is inside the edge of the soles; None for a robot that does not stand on soles.

    Raises ConfigError, with the centre of mass and the polygon, where it is outside.
    """
    if not robot.stands or not robot.body.mass.sum() > 0.0:
        return None
    stance = plant(robot, robot.profile.postures.stand)
    com = robot.body.solver_body().centre_of_mass(stance.q[None])[0]
    margin = float(support_distance(com, stance.edges(0.0)))
    if margin <= 0.0:
        polygon = convex_hull(np.concatenate([sole.outline for sole in stance.soles]))
        raise ConfigError(
            "the robot would fall over in posture stand",
            where=f"{robot.profile.path}: postures.stand",
            found=f"centre of mass at {_point(com)}, {-MM * margin:.1f} mm outside the soles",
            allowed="inside " + ", ".join(_point(corner) for corner in polygon),
            next_step="Lean the robot until it is inside (x forward, y left, mm, from the middle of the soles), or "
            "mend the masses of the body or the polygons of `feet`",
        )
    return margin


def _point(place: FloatArray) -> str:
    return f"({MM * place[0]:.0f}, {MM * place[1]:.0f})"
