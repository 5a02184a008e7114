"""Where the hands are asked, seen from the torso that is asked: from the performer and constants of the robot alone.

What the robot does takes no part, so a robot that stands still hides nothing. An asked hand is the asked shoulder and
the performer's arm, scaled, in the performer's heading (`landmarks`); so the asked shoulders are the asked hands less
those arms, and shoulders and pelvis tell how the asked torso is turned.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from retarget.facing import Facing
from retarget.human_dimensions import POINTS, HumanDimensions
from retarget.profile_parts import Landmark
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from retarget.stance import Stance

__all__ = ["HANDS", "Performance", "asked_arms"]

HANDS = ("l_hand", "r_hand")


@dataclass(frozen=True, eq=False)
class Performance:
    """What was asked, and of whom. joints (T, m, 3) m and pelvis (T, 4) wxyz: of the human, in the human's world.

    landmarks (T, k, 3) m: asked of the robot. dt: s between ticks, of the robot's clock.
    """

    dimensions: HumanDimensions
    joint_names: tuple[str, ...]
    joints: FloatArray
    pelvis: FloatArray
    landmark_names: tuple[str, ...]
    landmarks: FloatArray
    dt: float


def asked_arms(robot: RobotBody, stance: Stance, asked: Performance) -> dict[str, FloatArray]:
    """Hand -> place (T, 3) m where it is asked, as the torso carries it while the robot stands in its stance.

    Empty without landmarks for both hands.
    """
    entries = {name: robot.profile.landmarks[name] for name in HANDS if name in asked.landmark_names}
    if len(entries) < len(HANDS):
        return {}
    heading = _headings(asked)
    arms = {name: _turned(_limb(entry, asked), heading) + entry.offset for name, entry in entries.items()}
    stood = {name: np.mean([stance.points[frame] for frame in entry.anchor], axis=0) for name, entry in entries.items()}
    shoulders = {name: asked.landmarks[:, asked.landmark_names.index(name)] - arm for name, arm in arms.items()}
    turn = np.eye(3)
    if "pelvis" in asked.landmark_names:
        pelvis = asked.landmarks[:, asked.landmark_names.index("pelvis")]
        hips = stance.points[robot.profile.landmarks["pelvis"].frame]
        turn = _torso(shoulders, pelvis) @ _torso(stood, hips).T  # (T, 3, 3), from the stance to what is asked
    return {name: stood[name] + np.einsum("...ji,...j->...i", turn, arm) for name, arm in arms.items()}


def _headings(asked: Performance) -> FloatArray:
    """Unit vectors (T, 2) on the ground where the performer faces, as the landmarks have them."""
    feet = [_joint(asked, f"{side}_toe") - _joint(asked, f"{side}_ankle") for side in "lr"]
    facing, rows = Facing(), zip(asked.pelvis.tolist(), *(foot.tolist() for foot in feet), strict=True)
    return np.array([facing.update(pelvis, left, right, asked.dt) for pelvis, left, right in rows]).reshape(-1, 2)


def _limb(entry: Landmark, asked: Performance) -> FloatArray:
    """The performer's limb (T, 3) m of a landmark, scaled to the robot, in the performer's world."""
    rest = asked.dimensions.standing()
    chain = [np.mean([rest[POINTS.index(name)] for name in point], axis=0) for point in entry.human_length]
    scale = entry.robot_length / sum(float(np.linalg.norm(b - a)) for a, b in pairwise(chain))
    return np.asarray(scale * (_mean(asked, entry.follows) - _mean(asked, entry.measured_from)))


def _joint(asked: Performance, name: str) -> FloatArray:
    return np.asarray(asked.joints[:, asked.joint_names.index(name)])


def _mean(asked: Performance, names: Sequence[str]) -> FloatArray:
    return np.asarray(np.mean([_joint(asked, name) for name in names], axis=0))


def _turned(vectors: FloatArray, heading: FloatArray) -> FloatArray:
    """Vectors (T, 3) of the performer's world in the heading (T, 2)."""
    (x, y), (a, b, c) = heading.T, vectors.T
    return np.stack([x * a + y * b, x * b - y * a, c], axis=1)


def _torso(shoulders: Mapping[str, FloatArray], pelvis: FloatArray) -> FloatArray:
    """Axes (..., 3, 3), as columns, of a torso with these shoulders and this pelvis (..., 3): left, forward, up."""
    left, right = (shoulders[name] for name in HANDS)
    across, up = left - right, 0.5 * (left + right) - pelvis
    left_axis = across / np.linalg.norm(across, axis=-1, keepdims=True)
    forward = np.cross(left_axis, up)
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    return np.stack([left_axis, forward, np.cross(forward, left_axis)], axis=-1)
