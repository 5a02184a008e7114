"""Where the root of a standing robot is when its joints did something else than was asked: the planted sole tells."""

from math import nan, sqrt

import numpy as np

from retarget import rotations
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from retarget.scalar_rotations import Quat, Vector, inverse, minus, plus, product, rotated

__all__ = ["plant_root", "plant_roots"]


def plant_root(robot: RobotBody, before: FloatArray, q: FloatArray) -> None:
    """Move the root of a posture q (nq,) so that the lower sole is where it was in `before` (nq,).

    A robot that does not stand on feet keeps the root of `before`.
    """
    if robot.profile.root == "free":
        q[:7] = before[:7]
    if not robot.stands:
        return
    placed, links = robot.kinematics.forward(before)
    soles = [_sole(placed, links, sole.body, sole.position) for sole in robot.soles]
    lower = min(range(len(soles)), key=lambda foot: soles[foot][1][2])
    (there, planted), sole = soles[lower], robot.soles[lower]
    here, moved = _sole(*robot.kinematics.forward(q), sole.body, sole.position)
    turn = product(there, inverse(here))
    x, y, z, *orientation = q[:7].tolist()
    q[:3] = plus(planted, rotated(turn, minus((x, y, z), moved)))
    w, x, y, z = product(turn, _quat(orientation))
    norm = sqrt(w * w + x * x + y * y + z * z) or nan
    q[3:7] = (w / norm, x / norm, y / norm, z / norm)


def plant_roots(robot: RobotBody, before: FloatArray, q: FloatArray) -> None:
    """The same for postures q (T, nq), each from its own `before` (T, nq)."""
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


def _sole(placed: FloatArray, links: FloatArray, link: int, point: FloatArray) -> tuple[Quat, Vector]:
    """The orientation of a link, and where a point of it is, in the world; of all links: origins, orientations."""
    x, y, z = placed[link].tolist()
    turn = _quat(links[link].tolist())
    local_x, local_y, local_z = point.tolist()
    return turn, plus((x, y, z), rotated(turn, (local_x, local_y, local_z)))


def _quat(values: list[float]) -> Quat:
    w, x, y, z = values
    return (w, x, y, z)
