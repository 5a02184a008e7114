"""What is asked, turned into goals that the robot can go for in one tick: each task at a pace that can be braked.

See `pursuit`. The pace of a limb follows from the acceleration of its servos and from its length, so a new robot needs
no tuning.
"""

from dataclasses import dataclass

import numpy as np

from retarget.hierarchy import Hierarchy
from retarget.landmarks import AskedLandmarks
from retarget.pursuit import Pace, Pursuit
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from retarget.scalar_rotations import Quat, Vector, arc, inverse, product, rotated, rotation_vector, turn
from retarget.task_slots import SlotKind

__all__ = ["HEAD", "TRUNK", "Chase", "Reached"]

TRUNK, HEAD = "neck", "head"
"""Frames of the profile that carry the trunk's orientation and the eyes."""
OWN_SHARE, CATCH_SHARE = 1.0, 0.2
"""Shares of a servo's acceleration, at the length of the limb, for the asked motion's own and for catching up.

What a joint makes of a limb's acceleration depends on the posture; a fifth leaves room for unfavourable ones."""
SPEED_SHARE = 0.5
"""Share of a servo's speed for catching up."""
FAR = 1e3
"""How far (m) away the point is that the eyes are turned to: a direction."""


@dataclass(frozen=True, eq=False, slots=True)
class Reached:
    """Where the robot is: landmarks (k, 3) m, trunk wxyz relative to its stance, unit direction of the eyes."""

    landmarks: FloatArray
    trunk: Quat
    gaze: Vector


class Chase:
    """Goals of the hands, the pelvis and other landmarks, of the trunk and of the eyes."""

    def __init__(self, robot: RobotBody, hierarchy: Hierarchy, *, still: frozenset[str], trunk_at_stance: Quat) -> None:
        """still: landmarks that are planted. trunk_at_stance: orientation wxyz of the trunk's frame in the stance."""
        names = tuple(robot.profile.landmarks)
        self._rows = [
            row for row, name in enumerate(names) if name not in still and hierarchy.uses(SlotKind.POSITION, name)
        ]
        self._names = [names[row] for row in self._rows]
        self._hierarchy = hierarchy
        self._trunk_at_stance = trunk_at_stance
        self._pursuit = Pursuit(_pace(robot, self._names))
        self._before: tuple[FloatArray, Quat, Vector] | None = None
        self._moved = np.zeros((len(self._rows) + 2, 3))
        self._error = np.zeros((len(self._rows) + 2, 3))

    def restart(self) -> None:
        """Start at rest."""
        self._before = None
        self._pursuit.restart()

    def aim(self, targets: FloatArray, asked: AskedLandmarks, reached: Reached, dt: float, *, haste: float) -> None:
        """Write the goals of a tick of `dt` s into the target vector. haste: share of the catching-up speed."""
        moved, error = self._moved, self._error
        here = reached.landmarks[self._rows]
        points, trunk, gaze = asked.positions[self._rows], asked.trunk, asked.gaze
        before_points, before_trunk, before_gaze = self._before or (points, trunk, gaze)
        self._before = (points, trunk, gaze)
        moved[:-2] = points - before_points
        error[:-2] = points - here
        moved[-2] = rotation_vector(product(trunk, inverse(before_trunk)))
        error[-2] = rotation_vector(product(trunk, inverse(reached.trunk)))
        moved[-1] = rotation_vector(arc(before_gaze, gaze))
        error[-1] = rotation_vector(arc(reached.gaze, gaze))
        step = self._pursuit.step(moved, error, dt, haste=haste)
        goals = here + step[:-2]
        for name, goal in zip(self._names, goals, strict=True):
            self._hierarchy.set_position(targets, name, goal)
        (tx, ty, tz), (gx, gy, gz) = step[-2:].tolist()
        orientation = product(turn((tx, ty, tz)), product(reached.trunk, self._trunk_at_stance))
        self._hierarchy.set_orientation(targets, TRUNK, np.array(orientation))
        direction = rotated(turn((gx, gy, gz)), reached.gaze)
        self._hierarchy.set_look_at(targets, HEAD, FAR * np.array(direction))


def _pace(robot: RobotBody, names: list[str]) -> Pace:
    """Pace of the landmarks `names`, of the trunk and of the eyes."""
    limits, landmarks = robot.limits, robot.profile.landmarks
    lever = np.array([landmarks[name].robot_length for name in names] + [1.0, 1.0])
    acceleration = lever * float(limits.max_acceleration.min())
    speed = lever * float(limits.max_velocity.min())
    return Pace(OWN_SHARE * acceleration, CATCH_SHARE * acceleration, SPEED_SHARE * speed)
