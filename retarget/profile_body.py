"""Cross checks of a robot profile against its body file: links, joints, geoms and joint ranges."""

from collections.abc import Iterable
from dataclasses import dataclass
from os.path import normpath
from pathlib import Path
from typing import TYPE_CHECKING, Any

from retarget.body_file import compile_body, engine
from retarget.errors import InputError, Problem
from retarget.schema_errors import keys_of, unknown_name
from retarget.strict_yaml import Document

if TYPE_CHECKING:
    from retarget.profile import RobotProfile

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
    if not profile.body:  # unsound, and told already
        return []
    if leaves_folder(profile.body):
        what, allowed = "a path that leaves the profile's folder", "the name of a file beside the profile, or below it"
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
