"""A robot's profile: everything about the robot that its body file does not say. `configs/robots/<name>/robot.yaml`."""

from collections.abc import Iterable
from dataclasses import dataclass
from os.path import normpath
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PrivateAttr

from hardware.bus import BusSpec
from hardware.guard_state import GuardLimits
from hardware.servo import ServoSpec
from retarget.errors import InputError, Problem
from retarget.model.body_file import compile_body, engine
from retarget.schema.catalogue import Kind, find
from retarget.schema.profile_checks import check_parts
from retarget.schema.profile_parts import (
    Bus,
    Coupling,
    Foot,
    Frame,
    IgnorePair,
    Landmark,
    Observer,
    Postures,
    Servo,
    bus_specs,
    servo_specs,
)
from retarget.schema.profile_safety import Safety, guard_limits
from retarget.schema.strict_models import Name, Schema, Text, keys_of, read_model, unknown_name
from retarget.schema.strict_yaml import Document

# Cross checks of a robot profile against its body file: links, joints, geoms and joint ranges.

RANGE_TOLERANCE = 1e-4  # [rad] profiles write limits with four or five decimals


@dataclass(frozen=True)
class _BodyNames:
    """What a body file offers. joints: hinge or slide -> lower and upper limit (infinite where there is none)."""

    links: tuple[str, ...]
    joints: dict[str, tuple[float, float]]
    actuated: tuple[str, ...]
    geoms: dict[str, str]  # geom -> its link


def check_body(profile: "RobotProfile", document: Document, folder: Path) -> list[Problem]:
    """All problems of the profile with its body file, whose path is relative to `folder`."""
    if not profile.body:  # not valid, and reported already
        return []
    if leaves_folder(profile.body):
        what, allowed = "a path that leaves the profile's folder", "the name of a file in that folder, or below it"
        return [document.problem(("body",), what, found=profile.body, allowed=allowed)]
    try:
        body = _read(folder / profile.body, profile.root)
    except (InputError, ValueError) as error:  # ValueError: a path that no system can have
        reason = error.problems[0] if isinstance(error, InputError) else Problem(str(error), profile.body)
        return [
            document.problem(
                ("body",),
                f"the body cannot be used: {reason.what}",
                found=f"{reason.where}: {reason.found}" if reason.found else reason.where,
                allowed=reason.allowed,
                next_step="Give the path of an MJCF or URDF file, relative to the profile",
            )
        ]
    return [problem for check in (_links, _joints, _geoms) for problem in check(profile, document, body)]


def leaves_folder(path: str) -> bool:
    """Whether a path leads out of the folder that it is given in: a file from elsewhere must not name others."""
    inside = Path(normpath(path))
    return inside.is_absolute() or inside.parts[:1] == ("..",)


def _read(path: Path, root: Any) -> _BodyNames:
    mujoco = engine()

    model = compile_body(path, root=root).model
    single = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    joints = {}
    for index in range(model.njnt):
        if int(model.jnt_type[index]) in single:
            lower, upper = model.jnt_range[index] if model.jnt_limited[index] else (-float("inf"), float("inf"))
            joints[model.joint(index).name] = (float(lower), float(upper))
    driven = [
        model.joint(int(model.actuator_trnid[index, 0])).name
        for index in range(model.nu)
        if int(model.actuator_trntype[index]) == int(mujoco.mjtTrn.mjTRN_JOINT)
    ]
    return _BodyNames(
        links=tuple(model.body(index).name for index in range(1, model.nbody)),
        joints=joints,
        actuated=tuple(driven) or tuple(joints),
        geoms={model.geom(i).name: model.body(model.geom_bodyid[i]).name for i in range(model.ngeom)},
    )


def _links(profile: "RobotProfile", document: Document, body: _BodyNames) -> Iterable[Problem]:
    for section, entries in (("frames", profile.frames), ("observers", profile.observers)):
        for name, entry in entries.items():
            if entry.link not in body.links:
                yield unknown_name(document, (section, name, "link"), "link", entry.link, body.links)
    for index, ignored in enumerate(profile.ignore_pairs):
        for place, link in enumerate(ignored.pair):
            if link not in body.links:
                yield unknown_name(document, ("ignore_pairs", index, "pair", place), "link", link, body.links)


def _joints(profile: "RobotProfile", document: Document, body: _BodyNames) -> Iterable[Problem]:
    named = keys_of(document, "servos")
    for joint in named:
        if joint not in body.joints:
            yield unknown_name(document, ("servos", joint), "joint", joint, body.joints)
    without = [joint for joint in body.actuated if joint not in named]
    if without and "servos" in document.data:
        yield document.problem(
            ("servos",),
            "joints without a servo",
            found=", ".join(without),
            next_step="Give each joint that the body actuates a servo",
        )
    for joint, servo in profile.servos.items():
        lower, upper = body.joints.get(joint, servo.limits)
        if servo.limits[0] < lower - RANGE_TOLERANCE or servo.limits[1] > upper + RANGE_TOLERANCE:
            yield document.problem(
                ("servos", joint, "limits"),
                "limits outside the joint's range in the body",
                found=f"{servo.limits[0]} to {servo.limits[1]} rad",
                allowed=f"{lower:.4f} to {upper:.4f} rad",
            )


def _geoms(profile: "RobotProfile", document: Document, body: _BodyNames) -> Iterable[Problem]:
    for name, observer in profile.observers.items():
        geom = observer.shape.geom
        if geom is None:
            continue
        if geom not in body.geoms:
            yield unknown_name(document, ("observers", name, "shape", "geom"), "geom", geom, tuple(body.geoms))
        elif body.geoms[geom] != observer.link:
            yield document.problem(
                ("observers", name, "shape", "geom"),
                "the geom is on another link",
                found=f"{geom} on {body.geoms[geom]}",
                allowed=f"a geom of {observer.link}",
            )


class RobotProfile(Schema):
    """A robot. Names: links, joints and geoms are those of the body file; frames are the profile's own.

    `load_profile` makes one.
    """

    name: Name
    """By which it is chosen and called; of a shipped robot that of its folder."""
    body: Text
    """Body file, MJCF or URDF, relative to the profile's folder."""
    root: Literal["free", "fixed", "suspended"]
    """Whether the robot stands on its soles (free), is bolted down at its first link (fixed), or hangs (suspended)."""
    frames: Annotated[dict[Name, Frame], Field(max_length=200)]
    """Named points on links: hands, soles, head and whatever else landmarks and tasks are about."""
    servos: Annotated[dict[Name, Servo], Field(min_length=1, max_length=250)]
    """One per joint that moves, by the joint's name. The order is that of every array of the servo side."""
    couplings: Annotated[tuple[Coupling, ...], Field(max_length=16)] = ()
    """Pairs of joints that two servos turn together."""
    buses: Annotated[dict[Name, Bus], Field(min_length=1, max_length=16)]
    """Lines of servos, by name."""
    observers: Annotated[dict[Name, Observer], Field(max_length=200)]
    """Observers, by name."""
    ignore_pairs: Annotated[tuple[IgnorePair, ...], Field(max_length=500)]
    """Links that are never checked against each other."""
    feet: Annotated[dict[Name, Foot], Field(max_length=4)]
    """Soles by side (left, right); none of a robot that does not stand."""
    postures: Postures
    """What the robot's own postures are."""
    landmarks: Annotated[dict[Name, Landmark], Field(max_length=50)]
    """Which robot frame follows which part of the human, by name."""
    safety: Safety
    """Bounds of operation."""
    reconstruct: Name
    """Priority file of the first stage: sensors to human posture."""
    retarget: Name
    """Priority file of the second stage: human posture to robot posture."""
    standing: Name | None = None
    """The same for a robot on its own soles that can tip: a real one, in physics, where it steps. None: `balanced`,
    where `retarget` is `servo`, which looks at no motion; else `retarget`."""

    _path: Path = PrivateAttr(default=Path())

    @property
    def path(self) -> Path:
        """The file that the profile was read from."""
        return self._path

    @property
    def body_path(self) -> Path:
        """The body file, MJCF or URDF; `body` is relative to the profile's folder."""
        return self._path.parent / self.body

    def servo_specs(self) -> tuple[ServoSpec, ...]:
        """The servos for the hardware side, in the profile's order. Raises HardwareError for an unknown model."""
        return servo_specs(self.servos, self.couplings)

    def bus_specs(self) -> tuple[BusSpec, ...]:
        """The buses for the hardware side, in the profile's order."""
        return bus_specs(self.buses)

    def guard_limits(self) -> GuardLimits:
        """What the guard tolerates, by the profile's `safety`."""
        return guard_limits(self.safety)


def load_profile(path_or_name: str | Path) -> RobotProfile:
    """A robot's profile by shipped or user's name, path of the file, or path of its folder; checked against its body.

    Raises UsageError for an unknown name, ConfigError with all problems of the file.
    """
    path = find(Kind.ROBOT, path_or_name)
    profile, _ = read_model(RobotProfile, path, check=_check)
    profile._path = path
    return profile


def read_profile(path_or_name: str | Path) -> RobotProfile:
    """As `load_profile`, without any cross check and without reading the body: for lists of robots."""
    path = find(Kind.ROBOT, path_or_name)
    profile, _ = read_model(RobotProfile, path)
    profile._path = path
    return profile


def _check(profile: RobotProfile, document: Document) -> list[Problem]:
    return check_parts(profile, document) + check_body(profile, document, document.path.parent)


# The mark on lines of a drafted profile that a person who knows the robot must check.

DRAFT = "# DRAFT"


def marked_lines(text: str) -> tuple[int, ...]:
    """Numbers, from 1, of the lines of a profile that still end with the mark."""
    lines = enumerate(text.splitlines(), 1)
    return tuple(number for number, line in lines if DRAFT in line and not line.lstrip().startswith("#"))
