"""The base pose from contact: the pose of a robot's root that keeps its soles planted."""

from math import nan, sqrt

import numpy as np

from retarget import rotations
from retarget.model.robot import RobotBody
from retarget.rotations import Quat, Vector, as_quat, as_vector, inverse, minus, plus, product, rotated
from retarget.types import FloatArray


def plant_root(robot: RobotBody, before: FloatArray, q: FloatArray) -> None:
    """Move the root of a posture q (nq,) so that the lower sole is where it was in `before` (nq,).

    Without feet the root of `before` stays. A floating robot keeps its soles above the floor.
    """
    if robot.profile.root == "free":
        q[:7] = before[:7]
    if robot.floats:
        lift_soles(robot, q)
    if not robot.stands:
        return
    # The lower sole carries, as the higher one may be in the air.
    placed, links = robot.kinematics.forward(before)
    soles = [_sole(placed, links, sole.body, sole.position) for sole in robot.soles]
    lower = min(range(len(soles)), key=lambda foot: soles[foot][1][2])
    (there, planted), sole = soles[lower], robot.soles[lower]
    here, moved = _sole(*robot.kinematics.forward(q), sole.body, sole.position)
    # T_root' = T_planted * inverse(T_moved) * T_root
    turn = product(there, inverse(here))
    q[:3] = plus(planted, rotated(turn, minus(as_vector(q[:3]), moved)))
    w, x, y, z = product(turn, as_quat(q[3:7]))
    norm = sqrt(w * w + x * x + y * y + z * z) or nan
    q[3:7] = (w / norm, x / norm, y / norm, z / norm)


def plant_roots(robot: RobotBody, before: FloatArray, q: FloatArray) -> None:
    """Plant the roots of postures q (T, nq), each from its own `before` (T, nq)."""
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


def lift_soles(robot: RobotBody, q: FloatArray) -> None:
    """Raise the root of a posture q (nq,) until no corner of a sole is below the floor."""
    links, local = robot.sole_corners
    q[2] += max(0.0, -float(robot.kinematics.points(q[None], links, local)[0, :, 2].min()))


def _sole(placed: FloatArray, links: FloatArray, link: int, point: FloatArray) -> tuple[Quat, Vector]:
    turn = as_quat(links[link])
    return turn, plus(as_vector(placed[link]), rotated(turn, as_vector(point)))
