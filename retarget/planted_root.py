"""Where the root of a standing robot is when its joints did something else than was asked: the planted sole tells."""

import numpy as np

from retarget import rotations
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray

__all__ = ["plant_root"]


def plant_root(robot: RobotBody, before: FloatArray, q: FloatArray) -> None:
    """Move the root of posture q (nq,) so that the lower sole is where it was in the posture `before` (nq,).

    A robot that does not stand on feet keeps the root of `before`.
    """
    q[:7] = before[:7] if robot.profile.root == "free" else q[:7]
    if not robot.stands:
        return
    frames = tuple(foot.frame for foot in robot.profile.feet.values())
    both = np.stack([before, q])
    position, orientation = robot.points(both, frames), robot.orientations(both, frames)
    foot = int(np.argmin(position[0, :, 2]))
    turn = rotations.multiply(orientation[0, foot], rotations.conjugate(orientation[1, foot]))
    q[:3] = position[0, foot] + rotations.rotate(turn, q[:3] - position[1, foot])
    q[3:7] = rotations.normalise(rotations.multiply(turn, q[3:7]))
