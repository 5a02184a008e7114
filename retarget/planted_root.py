"""Where the root of a standing robot is when its joints did something else than was asked: the planted sole tells."""

import numpy as np

from retarget import rotations
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray

__all__ = ["plant_root"]


def plant_root(robot: RobotBody, before: FloatArray, q: FloatArray) -> None:
    """Move the root of a posture q (nq,), or of postures (T, nq), so that the lower sole is where it was in `before`.

    A robot that does not stand on feet keeps the root of `before`.
    """
    before, q = np.atleast_2d(before), np.atleast_2d(q)
    if robot.profile.root == "free":
        q[:, :7] = before[:, :7]
    if not robot.stands:
        return
    frames = tuple(foot.frame for foot in robot.profile.feet.values())
    planted, moved = robot.points(before, frames), robot.points(q, frames)
    rows = np.arange(len(q))
    foot = planted[:, :, 2].argmin(axis=1)
    there, here = (robot.orientations(postures, frames)[rows, foot] for postures in (before, q))
    turn = rotations.multiply(there, rotations.conjugate(here))
    q[:, :3] = planted[rows, foot] + rotations.rotate(turn, q[:, :3] - moved[rows, foot])
    q[:, 3:7] = rotations.normalise(rotations.multiply(turn, q[:, 3:7]))
