"""A robot as a run needs it: its profile, its kinematic tree and its servos, and where its frames are in a posture."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hardware.joint_map import JointMap
from retarget.model.body import BodyModel, Frame, JointLimits, load_body
from retarget.model.body_file import Root
from retarget.rotations import multiply
from retarget.schema.profile import RobotProfile, load_profile
from retarget.schema.servo_calibration import ServoCalibration, calibrated, read_calibration
from retarget.types import BoolArray, FloatArray

if TYPE_CHECKING:
    from retarget import _solver


TRUNK, HEAD = "neck", "head"
"""Frames of a profile that carry the trunk's orientation and the eyes."""


@dataclass(frozen=True, eq=False)
class RobotBody:
    """A robot. `servo_columns` (n,): where each servo's joint stands in q, in servo order. calibration: what the zero
    ticks of `joint_map` are from; None: those of the profile."""

    profile: RobotProfile
    body: BodyModel
    joint_map: JointMap
    servo_columns: NDArray[np.int64]
    calibration: ServoCalibration | None = None

    @property
    def limits(self) -> JointLimits:
        """Limits of the servos (n,), in servo order."""
        servos = self.joint_map
        return JointLimits(servos.lower, servos.upper, servos.max_velocity, servos.max_acceleration)

    @property
    def stands(self) -> bool:
        """Whether it stands on its own feet."""
        return self.profile.root == "free" and bool(self.profile.feet)

    @cached_property
    def kinematics(self) -> "_solver.Body":
        """The tree for the compiled solver, made once."""
        return self.body.solver_body()

    @cached_property
    def soles(self) -> tuple[Frame, ...]:
        """The frames of its feet."""
        return tuple(self.frame(foot.frame) for foot in self.profile.feet.values())

    def posture(self, angles: dict[str, float]) -> FloatArray:
        """Posture (nq,) with these joint angles, rad, and 0 elsewhere, the root as in the body file."""
        q = self.body.qpos0.copy()
        for joint, angle in angles.items():
            q[self.body.joint_qpos[self.body.joint_index(joint)]] = angle
        return q

    def frame(self, name: str) -> Frame:
        """A frame of the profile, on the body."""
        entry = self.profile.frames[name]
        return Frame(name, self.body.body_index(entry.link), np.array(entry.pos), np.array(entry.quat))

    def points(self, q: FloatArray, frames: tuple[str, ...]) -> FloatArray:
        """World positions (T, k, 3) m of frames of the profile, for postures (T, nq)."""
        places = [self.frame(name) for name in frames]
        local = np.array([place.position for place in places]).reshape(-1, 3)
        return self.kinematics.points(np.ascontiguousarray(q), [place.body for place in places], local)

    def orientations(self, q: FloatArray, frames: tuple[str, ...]) -> FloatArray:
        """World orientations (T, k, 4) wxyz of frames of the profile, for postures (T, nq)."""
        places = [self.frame(name) for name in frames]
        links = self.kinematics.orientations(np.ascontiguousarray(q), [place.body for place in places])
        return multiply(links, np.array([place.quat for place in places]).reshape(-1, 4))

    def landmark_frames(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """The frames that follow these landmarks."""
        return tuple(self.profile.landmarks[name].frame for name in names)


def load_robot(name_or_path: str | Path, *, root: Root | None = None) -> RobotBody:
    """A robot by name or by path, with its calibration where the user has one. root: instead of the profile's.

    Raises UsageError, ConfigError, InputError, HardwareError.
    """
    profile = load_profile(name_or_path)
    return robot_of(profile, read_calibration(profile), root=root)


def load_uncalibrated(name_or_path: str | Path) -> RobotBody:
    """As `load_robot`, with the zero ticks of the profile, whatever calibration there is."""
    return robot_of(load_profile(name_or_path), None)


def robot_of(profile: RobotProfile, calibration: ServoCalibration | None, *, root: Root | None = None) -> RobotBody:
    """The robot of a profile that is read, with this calibration. root: instead of the profile's.

    Raises InputError, HardwareError.
    """
    profile = profile if root is None else profile.model_copy(update={"root": root})
    body = load_body(profile.body_path, root=profile.root)
    specs = profile.servo_specs()
    joint_map = JointMap(specs if calibration is None else calibrated(specs, calibration))
    columns = body.joint_qpos[[body.joint_index(joint) for joint in joint_map.joints]]
    return RobotBody(profile, body, joint_map, columns, calibration)


# Which servos move one frame of a robot against others: those of the joints on the way from link to link.


def joints_between(robot: RobotBody, frame: str, others: Iterable[str]) -> BoolArray:
    """Servos (n,), in servo order, of the joints between the link of `frame` and those of the frames `others`.

    All of them where no joint lies between, or there are no others.
    """
    body = robot.body
    start, between = robot.frame(frame).body, set[int]()
    for other in others:
        between |= body.links_between(start, robot.frame(other).body)
    links = body.joint_body[[body.joint_index(joint) for joint in robot.joint_map.joints]]
    found = np.isin(links, sorted(between))
    return found if found.any() else np.ones_like(found)
