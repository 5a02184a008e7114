"""What is shown of a run beside the rows of its record: asked of it when a moment is shown, and only then."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from retarget.body import BodyModel, JointType
from retarget.rotations import FloatArray
from retarget.scene_motion import ObstaclePoses

__all__ = ["Beside", "Truth", "in_truth", "truth_names"]

ROOT, PRESSURE = 7, 2


@dataclass(frozen=True, eq=False)
class Truth:
    """Where a simulated body really is. root (7,): xyz and wxyz of its root link; angles (j,): of its hinges and slides
    in the order of the body; pressure (2,) m: centre of pressure of its soles, NaN where none carries."""

    root: FloatArray
    angles: FloatArray
    pressure: FloatArray

    def numbers(self) -> FloatArray:
        """All of it, (7 + j + 2,)."""
        return np.concatenate([self.root, self.angles, self.pressure])


def truth_names(body: BodyModel) -> tuple[str, ...]:
    """What the numbers of a `Truth` about a body are."""
    joints = [name for name, kind in zip(body.joint_names, body.joint_type, strict=True) if kind > JointType.BALL]
    return ("x", "y", "z", "qw", "qx", "qy", "qz", *joints, "pressure_x", "pressure_y")


def in_truth(body: BodyModel, goal: FloatArray, numbers: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Posture (nq,) of a body by the numbers of a `Truth`, and the centre of pressure (2,).

    A body whose root is held has the root of `goal`.
    """
    q = goal.copy()
    if body.root == "free":
        q[:ROOT] = numbers[:ROOT]
    q[body.joint_qpos[body.joint_type > JointType.BALL]] = numbers[ROOT:-PRESSURE]
    return q, numbers[-PRESSURE:]


@dataclass(frozen=True)
class Beside:
    """words: what the robot does now, and why. current: what its servos draw, (s,) A. around: where obstacles are.
    truth: where a simulated body really is. None: nobody knows, or there is none."""

    words: Callable[[], tuple[str, str]] = lambda: ("", "")
    current: Callable[[], FloatArray | None] = lambda: None
    around: Callable[[], ObstaclePoses | None] = lambda: None
    truth: Callable[[], Truth | None] = lambda: None
