"""What is asked, turned into goals that the robot can go for in one tick: each task at a pace that can be braked.

See `pursuit`. The pace of a limb follows from the acceleration of its own servos, the weakest of them, and from its
length, so a new robot needs no tuning.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from retarget.hierarchy import Hierarchy
from retarget.joints_between import joints_between
from retarget.landmarks import AskedLandmarks
from retarget.profile_parts import Landmark
from retarget.pursuit import Pace, Pursuit
from retarget.robot_body import HEAD, TRUNK, RobotBody
from retarget.rotations import FloatArray
from retarget.scalar_rotations import Quat, Vector, arc, inverse, minus, product, rotated, rotation_vector, turn
from retarget.task_slots import SlotKind

__all__ = ["Chase", "Reached"]

STANDING, HELD = (0.5, 0.2, 0.5), (2.0, 0.4, 1.0)
"""Shares of a servo's acceleration, at the length of the limb, for the asked motion's own and for catching up; and of
its speed for catching up. Of a robot on its soles, and of one that something else holds.

What a joint makes of a limb's acceleration depends on the posture; a fifth leaves room for unfavourable ones, and what
swings then tips nobody who is held. The own motion of a limb is that of several joints, of which one alone is looked at
here; a foot that kicks may have what two can."""
FAR = 1e3
"""How far (m) away the point is that the eyes are turned to: a direction."""


@dataclass(frozen=True, eq=False, slots=True)
class Reached:
    """Where the robot is, m, in its world.

    points (k, 3), and the same as tuples in `landmarks`; trunk: wxyz relative to its stance; gaze: unit direction of
    the eyes; centre_of_mass (3,).
    """

    points: FloatArray
    landmarks: list[Vector]
    trunk: Quat
    gaze: Vector
    centre_of_mass: FloatArray


class Chase:
    """Goals of the hands, the pelvis and other landmarks, of the trunk and of the eyes."""

    def __init__(
        self,
        robot: RobotBody,
        hierarchy: Hierarchy,
        *,
        still: frozenset[str],
        trunk_at_stance: Quat,
        ahead: float = 0.0,
    ) -> None:
        """still: landmarks that are planted. trunk_at_stance: orientation wxyz of the trunk's frame in the stance.
        ahead: s, see `Pursuit`."""
        names = tuple(robot.profile.landmarks)
        moving = [name for name in names if name not in still and hierarchy.uses(SlotKind.POSITION, name)]
        soles = [foot.frame for foot in robot.profile.feet.values()]
        self._rows = [names.index(name) for name in moving]
        self._points = [Pursuit(_landmark_pace(robot, robot.profile.landmarks[name]), ahead=ahead) for name in moving]
        self._trunk = Pursuit(_pace(robot, TRUNK, soles), ahead=ahead)
        self._gaze = Pursuit(_pace(robot, HEAD, [TRUNK]), ahead=ahead)
        self._source, self._slots = hierarchy.position_slots(moving)
        self._hierarchy = hierarchy
        self._trunk_at_stance = trunk_at_stance
        self._before: AskedLandmarks | None = None

    def restart(self) -> None:
        """Start at rest."""
        self._before = None
        for pursuit in (*self._points, self._trunk, self._gaze):
            pursuit.restart()

    def aim(self, targets: FloatArray, asked: AskedLandmarks, reached: Reached, dt: float, *, haste: float) -> None:
        """Write the goals of a tick of `dt` s into the target vector. haste: see `Pursuit`."""
        before = asked if self._before is None else self._before
        self._before = asked
        goals = []
        for row, pursuit in zip(self._rows, self._points, strict=True):
            here, there, last = reached.landmarks[row], asked.landmarks[row], before.landmarks[row]
            x, y, z = pursuit.step(minus(there, last), minus(there, here), dt, haste=haste)
            weight = 0.0 if row in asked.open else 1.0
            goals.append((weight, here[0] + x, here[1] + y, here[2] + z))
        targets[self._slots] = np.array(goals)[self._source]

        moved = rotation_vector(product(asked.trunk, inverse(before.trunk)))
        error = rotation_vector(product(asked.trunk, inverse(reached.trunk)))
        trunk = product(turn(self._trunk.step(moved, error, dt, haste=haste)), reached.trunk)
        self._hierarchy.set_orientation(targets, TRUNK, np.array(product(trunk, self._trunk_at_stance)))

        moved, error = rotation_vector(arc(before.gaze, asked.gaze)), rotation_vector(arc(reached.gaze, asked.gaze))
        x, y, z = rotated(turn(self._gaze.step(moved, error, dt, haste=haste)), reached.gaze)
        self._hierarchy.set_look_at(targets, HEAD, np.array((FAR * x, FAR * y, FAR * z)))


def _landmark_pace(robot: RobotBody, landmark: Landmark) -> Pace:
    return _pace(robot, landmark.frame, landmark.anchor, landmark.robot_length)


def _pace(robot: RobotBody, frame: str, others: Sequence[str], lever: float = 1.0) -> Pace:
    """Pace of a frame that the joints between it and `others` move, `lever` m away from them (of a rotation: 1)."""
    limits, movers = robot.limits, joints_between(robot, frame, others)
    acceleration = lever * float(limits.max_acceleration[movers].min())
    speed = lever * float(limits.max_velocity[movers].min())
    own, catch_up, fast = STANDING if robot.stands else HELD
    return Pace(own * acceleration, catch_up * acceleration, fast * speed)
