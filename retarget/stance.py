"""Where a robot stands: a posture with the soles on the ground, the origin between them, x forward."""

from dataclasses import dataclass

import numpy as np

from retarget import rotations
from retarget.body import Frame
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from retarget.support import sole_outline, support_edges

__all__ = ["Sole", "Stance", "plant"]


@dataclass(frozen=True, eq=False)
class Sole:
    """A planted sole.

    frame: on its link. position (3,) m and orientation (4,) wxyz of it, flat on the ground, world. outline (c, 2) m:
    its corners on the ground, world; corners (c, 3) m: the same in the frame of the link.
    """

    frame: Frame
    position: FloatArray
    orientation: FloatArray
    outline: FloatArray
    corners: FloatArray


@dataclass(frozen=True, eq=False)
class Stance:
    """q (nq,): posture, root included. points: world position (3,) m of every frame of the profile in it.

    soles: none for a robot whose root is fixed or hangs.
    """

    q: FloatArray
    points: dict[str, FloatArray]
    soles: tuple[Sole, ...]

    def edges(self, margin: float) -> FloatArray:
        """Edges (e, 3) of the support polygon, `margin` m inside the soles' hull (see `support`)."""
        return support_edges([sole.outline for sole in self.soles], margin=margin)


def plant(robot: RobotBody, angles: dict[str, float]) -> Stance:
    """Stand with these joint angles, rad (0 elsewhere). A robot on a stand keeps the root of its body file.

    The soles are taken as flat and at the same height; what they lack of it in this posture is for the legs to mend.
    """
    q = robot.posture(angles)
    feet = robot.profile.feet if robot.profile.root == "free" else {}
    frames = tuple(foot.frame for foot in feet.values())
    if frames:
        _to_origin(q, robot.points(q[None], frames)[0], robot.orientations(q[None], frames)[0])
    names = tuple(robot.profile.frames)
    points = dict(zip(names, robot.points(q[None], names)[0], strict=True))
    soles = []
    for foot, orientation in zip(feet.values(), robot.orientations(q[None], frames)[0] if frames else (), strict=True):
        place = points[foot.frame] * np.array([1.0, 1.0, 0.0])
        flat = _level(orientation)
        frame, polygon = robot.frame(foot.frame), np.array(foot.polygon)
        corners = frame.position + rotations.rotate(frame.quat, np.column_stack([polygon, np.zeros(len(polygon))]))
        soles.append(Sole(frame, place, flat, sole_outline(place, flat, polygon), corners))
    return Stance(q, points, tuple(soles))


def _to_origin(q: FloatArray, positions: FloatArray, orientations: FloatArray) -> None:
    """Move the root of q (nq,) so that the soles (k, 3), (k, 4) are level, face x, with their middle at the origin."""
    up = rotations.rotate(orientations, np.array([0.0, 0.0, 1.0])).mean(axis=0)
    level = rotations.shortest_arc(up, np.array([0.0, 0.0, 1.0]))
    forward = rotations.rotate(rotations.multiply(level, orientations), np.array([1.0, 0.0, 0.0])).mean(axis=0)
    turn = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), -np.arctan2(forward[1], forward[0]))
    upright = rotations.multiply(turn, level)
    q[:3] = rotations.rotate(upright, q[:3] - positions.mean(axis=0))
    q[3:7] = rotations.normalise(rotations.multiply(upright, q[3:7]))


def _level(orientation: FloatArray) -> FloatArray:
    """The orientation (4,) made flat: only its turn about the vertical is kept."""
    forward = rotations.rotate(orientation, np.array([1.0, 0.0, 0.0]))
    return rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.arctan2(forward[1], forward[0]))
