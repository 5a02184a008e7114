"""A robot: its profile, checked against its body file, its kinematic tree, its servos and its frames."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property
from hashlib import sha256
from math import nan, sqrt
from os.path import normpath
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from hardware.joint_map import JointMap
from retarget.errors import InputError, Problem
from retarget.model.body import BodyModel, Frame, JointLimits, JointType, body_from_file, load_body
from retarget.model.body_file import BodyFile, Root, compile_body
from retarget.model.meshes import SolidBody, solid_body
from retarget.rotations import (
    Quat,
    Vector,
    as_quat,
    as_vector,
    conjugate,
    inverse,
    minus,
    multiply,
    normalise,
    plus,
    product,
    rotate,
    rotated,
)
from retarget.schema.profile import RobotProfile, read_profile
from retarget.schema.profile_checks import check_parts
from retarget.schema.servo_calibration import ServoCalibration, calibrated, read_calibration
from retarget.schema.strict_models import keys_of, unknown_name
from retarget.schema.strict_yaml import Document, KeyPath
from retarget.types import BoolArray, FloatArray

if TYPE_CHECKING:
    from retarget import _solver


Mounting = Root | Literal["floating"]
"""Root of a loaded robot: a profile's, or floating."""
TRUNK, HEAD = "neck", "head"
"""Frames of a profile for the orientations of trunk and eyes."""


@dataclass(frozen=True, eq=False)
class RobotBody:
    """A robot. servo_columns (n,): column in q of each servo's joint. calibration: source of the zero ticks; None: the
    profile. floats: its root follows the performer, for viewers and training."""

    profile: RobotProfile
    body: BodyModel
    joint_map: JointMap
    servo_columns: NDArray[np.int64]
    calibration: ServoCalibration | None = None
    floats: bool = False

    @property
    def limits(self) -> JointLimits:
        """Limits of the servos (n,)."""
        servos = self.joint_map
        return JointLimits(servos.lower, servos.upper, servos.max_velocity, servos.max_acceleration)

    @property
    def stands(self) -> bool:
        """True if it stands on its own feet."""
        return self.on_floor and not self.floats

    @property
    def on_floor(self) -> bool:
        """True if there is a floor below its feet."""
        return self.profile.root == "free" and bool(self.profile.feet)

    @cached_property
    def sole_corners(self) -> tuple[list[int], FloatArray]:
        """Links (c,) of the corners of all soles, and the corners (c, 3) m in their frames."""
        links, local = list[int](), []
        for foot in self.profile.feet.values():
            frame, polygon = self.frame(foot.frame), np.array(foot.polygon)
            local.append(frame.position + rotate(frame.quat, np.column_stack([polygon, np.zeros(len(polygon))])))
            links += [frame.body] * len(polygon)
        return links, np.concatenate(local) if local else np.zeros((0, 3))

    @cached_property
    def kinematics(self) -> "_solver.Body":
        """The tree for the compiled solver."""
        return self.body.solver_body()

    @cached_property
    def content(self) -> bytes:
        """A digest of profile and body."""
        digest = sha256(f"{self.floats} {self.profile!r}".encode())
        for part in _content(self.body):
            digest.update(part)
        return digest.digest()

    @cached_property
    def solid(self) -> SolidBody:
        """The body to draw."""
        return solid_body(self.body, self.frame_links)

    @property
    def frame_links(self) -> dict[str, int]:
        """The link of each frame of the profile."""
        return {name: self.frame(name).body for name in self.profile.frames}

    @cached_property
    def soles(self) -> tuple[Frame, ...]:
        """The frames of its feet."""
        return tuple(self.frame(foot.frame) for foot in self.profile.feet.values())

    @cached_property
    def foot_links(self) -> tuple[frozenset[str], ...]:
        """The links of each foot: that of its sole, and links fixed to it."""
        moving = {name: self.body.moved_with(link) for link, name in enumerate(self.body.body_names)}
        held = [self.body.moved_with(sole.body) for sole in self.soles]
        return tuple(frozenset(name for name, link in moving.items() if link == one) for one in held)

    def posture(self, angles: dict[str, float]) -> FloatArray:
        """Posture (nq,) with these joint angles, rad, and 0 elsewhere, the root as in the body file."""
        return self.body.posture(angles)

    def frame(self, name: str) -> Frame:
        """Frame of the profile, on the body."""
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
        """Frames of landmarks."""
        return tuple(self.profile.landmarks[name].frame for name in names)


def _content(value: object) -> Iterator[bytes]:
    """All numbers and names of a body, without its source and notes."""
    if isinstance(value, np.ndarray):
        yield f"{value.dtype} {value.shape} ".encode() + value.tobytes()
    elif isinstance(value, tuple):
        yield f"{len(value)} ".encode()
        for one in value:
            yield from _content(one)
    elif is_dataclass(value):
        for field in fields(value):
            if field.name not in {"source", "notes"}:
                yield from _content(getattr(value, field.name))
    else:
        yield f"{value!r} ".encode()


def load_profile(path_or_name: str | Path) -> RobotProfile:
    """Read a robot's profile by name or path, and check it against its body.

    Raises UsageError for an unknown name, ConfigError with all problems of the file.
    """
    return _read_with_body(path_or_name)[0]


def _read_with_body(path_or_name: str | Path) -> tuple[RobotProfile, BodyModel]:
    bodies: list[BodyModel] = []

    def check(profile: RobotProfile, document: Document) -> list[Problem]:
        return check_parts(profile, document) + _check_body(profile, document, bodies)

    profile = read_profile(path_or_name, check=check)
    return profile, bodies[0]


def load_robot(name_or_path: str | Path, *, root: Mounting | None = None) -> RobotBody:
    """Load a robot by name or path, with the user's calibration. root: replaces the profile's.

    Raises UsageError, ConfigError, InputError, HardwareError.
    """
    profile, body = _read_with_body(name_or_path)
    return robot_of(profile, read_calibration(profile), root=root, body=body)


def load_uncalibrated(name_or_path: str | Path) -> RobotBody:
    """Load a robot with the zero ticks of its profile."""
    profile, body = _read_with_body(name_or_path)
    return robot_of(profile, None, body=body)


def robot_of(
    profile: RobotProfile,
    calibration: ServoCalibration | None,
    *,
    root: Mounting | None = None,
    body: BodyModel | None = None,
) -> RobotBody:
    """Robot of a profile, with this calibration. root: replaces the profile's. body: of the profile, if it
    is loaded. Raises InputError, HardwareError."""
    floats = root == "floating"
    if root is not None:
        profile = profile.model_copy(update={"root": "free" if floats else root})
    if body is None or body.root != profile.root:
        body = load_body(profile.body_path, root=profile.root)
    specs = profile.servo_specs()
    joint_map = JointMap(specs if calibration is None else calibrated(specs, calibration))
    columns = body.joint_qpos[[body.joint_index(joint) for joint in joint_map.joints]]
    return RobotBody(profile, body, joint_map, columns, calibration, floats)


def joints_between(robot: RobotBody, frame: str, others: Iterable[str]) -> BoolArray:
    """Mask (n,) of the servos between the link of `frame` and those of `others`; all of them without any joint
    between."""
    body = robot.body
    start, between = robot.frame(frame).body, set[int]()
    for other in others:
        between |= body.links_between(start, robot.frame(other).body)
    links = body.joint_body[[body.joint_index(joint) for joint in robot.joint_map.joints]]
    found = np.isin(links, sorted(between))
    return found if found.any() else np.ones_like(found)


RANGE_TOLERANCE = 1e-4  # [rad] profiles write limits with four or five decimals


def leaves_folder(path: str) -> bool:
    """True for a path out of its folder: files of others must not name such paths."""
    inside = Path(normpath(path))
    return inside.is_absolute() or inside.parts[:1] == ("..",)


def _check_body(profile: RobotProfile, document: Document, bodies: list[BodyModel]) -> list[Problem]:
    """All problems of the profile with its body file. Adds the body to `bodies`."""
    if not profile.body:  # not valid, and reported already
        return []
    if leaves_folder(profile.body):
        what, allowed = "a path that leaves the profile's folder", "the name of a file in that folder, or below it"
        return [document.problem(("body",), what, found=profile.body, allowed=allowed)]
    try:
        file = compile_body(document.path.parent / profile.body, root=profile.root)
    except InputError as error:
        reason = error.problems[0]
        return [
            document.problem(
                ("body",),
                f"the body cannot be used: {reason.what}",
                found=f"{reason.where}: {reason.found}" if reason.found else reason.where,
                allowed=reason.allowed,
                next_step="Give the path of an MJCF or URDF file, relative to the profile",
            )
        ]
    body = body_from_file(file)
    bodies.append(body)
    links, joints = _links(profile, document, body.body_names[1:]), _joints(profile, document, body, file)
    return [*links, *joints, *_geoms(profile, document, body)]


def _links(profile: RobotProfile, document: Document, links: tuple[str, ...]) -> Iterable[Problem]:
    named: dict[KeyPath, str] = {} if profile.imu is None else {("imu", "link"): profile.imu.link}
    named |= {("frames", name, "link"): frame.link for name, frame in profile.frames.items()}
    named |= {("observers", name, "link"): observer.link for name, observer in profile.observers.items()}
    pairs = [ignored.pair for ignored in profile.ignore_pairs]
    in_pairs = {("ignore_pairs", i, "pair", j): link for i, pair in enumerate(pairs) for j, link in enumerate(pair)}
    for key_path, link in (named | in_pairs).items():
        if link not in links:
            yield unknown_name(document, key_path, "link", link, links)


def _joints(profile: RobotProfile, document: Document, body: BodyModel, file: BodyFile) -> Iterable[Problem]:
    import mujoco

    named = keys_of(document, "servos")
    single = (JointType.SLIDE, JointType.HINGE)
    joints = {name: int(body.joint_dof[i]) for i, name in enumerate(body.joint_names) if body.joint_type[i] in single}
    for joint in named:
        if joint not in joints:
            yield unknown_name(document, ("servos", joint), "joint", joint, joints)
    # The joints that the file's own actuators drive.
    model, on_joint = file.model, int(mujoco.mjtTrn.mjTRN_JOINT)
    driven = [int(model.actuator_trnid[i, 0]) for i in range(model.nu) if int(model.actuator_trntype[i]) == on_joint]
    without = [joint for joint in [model.joint(one).name for one in driven] or joints if joint not in named]
    if without and "servos" in document.data:
        step = "Give each joint that the body actuates a servo"
        yield document.problem(("servos",), "joints without a servo", found=", ".join(without), next_step=step)
    for joint, servo in profile.servos.items():
        if joint not in joints:
            continue
        lower, upper = body.lower[joints[joint]], body.upper[joints[joint]]
        if servo.limits[0] < lower - RANGE_TOLERANCE or servo.limits[1] > upper + RANGE_TOLERANCE:
            yield document.problem(
                ("servos", joint, "limits"),
                "limits outside the joint's range in the body",
                found=f"{servo.limits[0]} to {servo.limits[1]} rad",
                allowed=f"{lower:.4f} to {upper:.4f} rad",
            )


def _geoms(profile: RobotProfile, document: Document, body: BodyModel) -> Iterable[Problem]:
    link_of = {geom.name: body.body_names[geom.body] for geom in body.geoms if geom.name}
    for name, observer in profile.observers.items():
        geom, here = observer.shape.geom, ("observers", name, "shape", "geom")
        if geom is not None and geom not in link_of:
            yield unknown_name(document, here, "geom", geom, link_of)
        elif geom is not None and link_of[geom] != observer.link:
            found, allowed = f"{geom} on {link_of[geom]}", f"a geom of {observer.link}"
            yield document.problem(here, "the geom is on another link", found=found, allowed=allowed)


# The base pose from contact: the pose of the root that keeps the soles planted.


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
    turn = multiply(there, conjugate(here))
    q[:, :3] = planted[rows, foot] + rotate(turn, q[:, :3] - moved[rows, foot])
    q[:, 3:7] = normalise(multiply(turn, q[:, 3:7]))


def lift_soles(robot: RobotBody, q: FloatArray) -> None:
    """Raise the root of a posture q (nq,) until no corner of a sole is below the floor."""
    links, local = robot.sole_corners
    q[2] += max(0.0, -float(robot.kinematics.points(q[None], links, local)[0, :, 2].min()))


def _sole(placed: FloatArray, links: FloatArray, link: int, point: FloatArray) -> tuple[Quat, Vector]:
    turn = as_quat(links[link])
    return turn, plus(as_vector(placed[link]), rotated(turn, as_vector(point)))
