"""Cross checks of a robot profile that need no body file: names that refer to each other, limits, soles, landmarks.

Every check takes the sound part of a profile and its document, and returns problems with their places. Names are looked
up among the keys of the document, so that an entry with an error of its own is not called unknown as well.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from retarget.errors import Problem
from retarget.frames import JOINTS
from retarget.profile_parts import Landmark, Point2
from retarget.profile_safety import check_safety
from retarget.profile_servos import check_buses, check_couplings, check_servos
from retarget.schema_errors import keys_of, listed, unknown_name
from retarget.strict_yaml import Document

if TYPE_CHECKING:
    from retarget.profile import RobotProfile

LANDMARKS = ("l_hand", "r_hand", "head")
"""Landmarks that every robot needs; one that stands on its feet needs the next ones too."""
STANDING_LANDMARKS = ("pelvis", "l_sole", "r_sole")
MIN_AREA = 1e-9  # [m^2] twice the area of the smallest triangle that counts as a turn


def check_parts(profile: "RobotProfile", document: Document) -> list[Problem]:
    """All problems of the profile by itself."""
    checks = (
        check_servos,
        check_buses,
        check_couplings,
        _frame_names,
        _feet,
        _postures,
        _landmarks,
        _observers,
        _ignore_pairs,
        check_safety,
    )
    return [problem for check in checks for problem in check(profile, document)]


def _frame_names(profile: "RobotProfile", document: Document) -> Iterable[Problem]:
    frames = keys_of(document, "frames")
    for name, foot in profile.feet.items():
        if foot.frame not in frames:
            yield unknown_name(document, ("feet", name, "frame"), "frame", foot.frame, frames)
    for name, landmark in profile.landmarks.items():
        for key, named in (("frame", (landmark.frame,)), ("anchor", landmark.anchor)):
            for frame in named:
                if frame not in frames:
                    yield unknown_name(document, ("landmarks", name, key), "frame", frame, frames)


def _feet(profile: "RobotProfile", document: Document) -> Iterable[Problem]:
    for name, foot in profile.feet.items():
        if not is_convex(foot.polygon):
            yield document.problem(
                ("feet", name, "polygon"),
                "the sole's outline is not convex and counter-clockwise",
                found=" ".join(f"({x:g}, {y:g})" for x, y in foot.polygon),
                allowed="corners in counter-clockwise order seen from above, without dents",
                next_step="Reorder the corners, or leave out those that dent",
            )


def is_convex(polygon: tuple[Point2, ...]) -> bool:
    """Whether no three neighbours are in line and every corner lies to the left of every edge (or on it)."""
    edges = list(zip(polygon, polygon[1:] + polygon[:1], strict=True))
    after = polygon[2:] + polygon[:2]
    turns_left = all(_side(*edge, corner) > MIN_AREA for edge, corner in zip(edges, after, strict=True))
    return turns_left and all(_side(*edge, corner) > -MIN_AREA for edge in edges for corner in polygon)


def _side(start: Point2, end: Point2, point: Point2) -> float:
    """Twice the signed area of the triangle, m^2: positive where `point` is left of the line from `start` to `end`."""
    return (end[0] - start[0]) * (point[1] - start[1]) - (end[1] - start[1]) * (point[0] - start[0])


def _postures(profile: "RobotProfile", document: Document) -> Iterable[Problem]:
    joints = keys_of(document, "servos")
    for name in ("neutral", "stand", "rest", "attractor"):
        posture = getattr(profile.postures, name, None)  # absent where the section is unsound
        if posture is None:
            continue
        for joint in posture:
            if joint not in joints:
                yield unknown_name(document, ("postures", name, joint), "joint", joint, joints)
        for joint, servo in profile.servos.items():
            angle = posture.get(joint, 0.0)
            if not servo.limits[0] <= angle <= servo.limits[1]:
                yield document.problem(
                    ("postures", name, joint),
                    "posture outside the joint's limits",
                    found=f"{angle} rad" + ("" if joint in posture else " (not named, so 0)"),
                    allowed=f"{servo.limits[0]} to {servo.limits[1]} rad",
                )


def _landmarks(profile: "RobotProfile", document: Document) -> Iterable[Problem]:
    present = keys_of(document, "landmarks")
    needed = LANDMARKS + (STANDING_LANDMARKS if profile.root == "free" else ())
    missing = [name for name in needed if name not in present]
    if missing and "landmarks" in document.data:
        step = f"Add {', '.join(missing)}"
        yield document.problem(
            ("landmarks",), "landmarks are missing", found=listed(present), allowed=listed(needed), next_step=step
        )
    for name, landmark in profile.landmarks.items():
        for key, joint in _human_joints(landmark):
            if joint not in JOINTS:
                yield unknown_name(document, ("landmarks", name, key), "human joint", joint, JOINTS)


def _human_joints(landmark: Landmark) -> Iterable[tuple[str, str]]:
    yield from (("follows", joint) for joint in landmark.follows)
    yield from (("from", joint) for joint in landmark.measured_from)
    yield from (("human_length", joint) for point in landmark.human_length for joint in point)


def _observers(profile: "RobotProfile", document: Document) -> Iterable[Problem]:
    for name, observer in profile.observers.items():
        if observer.margin >= observer.influence:
            yield document.problem(
                ("observers", name, "margin"),
                "the margin must be smaller than the influence",
                found=f"{observer.margin} m",
                allowed=f"less than {observer.influence} m",
            )


def _ignore_pairs(profile: "RobotProfile", document: Document) -> Iterable[Problem]:
    for index, ignored in enumerate(profile.ignore_pairs):
        if ignored.pair[0] == ignored.pair[1]:
            found = f"{ignored.pair[0]} twice"
            yield document.problem(("ignore_pairs", index, "pair"), "a pair needs two different links", found=found)
