"""A joint tree in motion -> sensor frames: which joint is which, where forward is, how long a unit is.

Canonical joints that the names do not give come from the tree: the chest is where neck and arms part, the spine joint
lies half way up to it, the head's centre is half way between the head joint and the top of the head, and the toe joint,
where a file has none, is the end of the foot.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from retarget import rotations
from retarget.arithmetic import dot, log, matmul, norm, norms
from retarget.errors import InputError, UsageError, suggest
from retarget.frames import JOINTS, SENSORS, JointTracks, SensorFrames, Skeleton, stature
from retarget.sources.files import frame_times
from retarget.sources.skeletons import JointTree, Pose, joints_by_name, joints_by_shape, missing_joints, shared_path
from retarget.types import FloatArray

# Which way is up, left and forward in a motion file, from the body itself.

REST_AXES_ERROR = "the rest pose of the skeleton has no up and left"

UPRIGHT = 0.7
"""Mean share of the line from ankles to head that must lie along an axis before the frames decide what is up."""


def axes_with_up(up: FloatArray) -> FloatArray:
    """World axes (3, 3) of a file with this up axis (3,): the file's axes in their cyclic order (y up: forward z, left
    x), as rows forward, left, up. The heading stays as recorded.
    """
    axis = int(np.argmax(np.abs(up)))
    first, second = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
    return np.stack((first, second, up) if up[axis] > 0 else (second, first, up))


def rest_axes(rest: dict[str, FloatArray], *, where: str = "") -> FloatArray | None:
    """Axes (3, 3) of the rest pose, rows forward, left, up, each along a file axis: up from hips to head, left from the
    right hip to the left; None if they coincide. Raises InputError where arms and legs do not agree which side is left.
    where: the file."""
    up = _nearest_axis(rest["head"] - 0.5 * (rest["l_hip"] + rest["r_hip"]))
    if up is None:
        return None
    hips, shoulders = (rest[f"l_{part}"] - rest[f"r_{part}"] for part in ("hip", "shoulder"))
    if dot(hips, shoulders) < 0.0:
        raise InputError(
            "left and right are swapped between arms and legs: in the rest pose they run in opposite directions",
            where=where,
            next_step="Exchange the names of the left and the right arm (or leg) joints in the program that wrote it",
        )
    across = hips + shoulders
    left = _nearest_axis(across * (up == 0.0))
    return None if left is None else np.stack((np.cross(left, up), left, up))


def world_axes(body: FloatArray, tracks: dict[str, FloatArray]) -> tuple[FloatArray, tuple[str, ...]]:
    """World axes (3, 3) of a recording, from those of its rest pose, and a note where its frames stand along another
    axis than its rest pose.

    tracks: canonical joints (T, 3) in file axes. Some exporters write a rest pose with y up and a world with z up:
    there the body stands upright along z all the time, with its feet near z = 0.
    """
    ankles = 0.5 * (tracks["l_ankle"] + tracks["r_ankle"])
    standing = tracks["head"] - ankles
    height = norms(standing)[:, None]
    direction = np.mean(standing / np.where(height > 0.0, height, 1.0), axis=0)
    axis = int(np.argmax(np.abs(direction)))
    near_ground = abs(float(np.min(ankles[:, axis]))) < 0.3 * float(np.median(height))
    if direction[axis] < UPRIGHT or body[2, axis] > 0.0 or not near_ground:
        return axes_with_up(body[2]), ()
    note = (
        f"the body stands along {'xyz'[axis]} in the frames: taken as the up axis, though the rest pose says otherwise"
    )
    return axes_with_up(np.eye(3)[axis]), (note,)


def _nearest_axis(direction: FloatArray) -> FloatArray | None:
    """The signed coordinate axis nearest to a direction; None for a zero or non-finite one."""
    if not (np.all(np.isfinite(direction)) and direction.any()):
        return None
    axis = int(np.argmax(np.abs(direction)))
    return np.asarray(np.eye(3)[axis] * np.sign(direction[axis]))


# Length units of motion files, given by the user or guessed from the size of the body.

CMU_METRES = 0.0254 / 0.45
"""One unit of the CMU recordings (ASF `length 0.45`) in metres."""

UNITS: dict[str, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "cmu": CMU_METRES}
"""Metres per unit."""

TYPICAL_HEIGHT_M = 1.7
USUAL_HEIGHT_M = (1.4, 2.1)
POSSIBLE_HEIGHT_M = (1.0, 2.5)
"""Statures, m: a unit is guessed so that the body comes nearest to the first; outside of the second a note says so,
and outside of the third the file is refused."""


def named_unit(name: str | None) -> float | None:
    """Metres of the unit that the user named, None without one. Raises UsageError with the nearest names."""
    if name is None:
        return None
    key = name.lower()
    if key not in UNITS:
        raise UsageError("unknown unit", found=repr(name), allowed=", ".join(UNITS), next_step=suggest(key, UNITS))
    return UNITS[key]


def choose_unit(body_height: float | None, *, where: str) -> tuple[float, str]:
    """Metres of the unit in which a body of this height (file units) is nearest to a human, and a note that says so.

    Raises InputError if no unit makes it a human at all.
    """
    if body_height is None or not 0.0 < body_height < math.inf:
        raise InputError("the skeleton has no height", where=where, next_step="Say the unit with --unit")
    name = min(UNITS, key=lambda unit: abs(log(body_height * UNITS[unit] / TYPICAL_HEIGHT_M)))
    height = body_height * UNITS[name]
    if not POSSIBLE_HEIGHT_M[0] <= height <= POSSIBLE_HEIGHT_M[1]:
        raise InputError(
            "the skeleton fits a human in no known unit",
            where=where,
            found=f"a body {body_height:.4g} units high",
            allowed=f"{POSSIBLE_HEIGHT_M[0]} to {POSSIBLE_HEIGHT_M[1]} m in one of {', '.join(UNITS)}",
            next_step="Say the unit with --unit",
        )
    note = f"unit not stated: taken as {name}, which makes the body {height:.2f} m high (change it with --unit)"
    if not USUAL_HEIGHT_M[0] <= height <= USUAL_HEIGHT_M[1]:
        note += "; that is unusual for an adult"
    return UNITS[name], note


_SEGMENT_END = {"shoulder": "elbow", "elbow": "wrist", "hip": "knee", "knee": "ankle"}
"""Segments of limbs, by the joints where they begin and end. A file may split them (twist joints): the part next to the
far joint gives the orientation."""


@dataclass(frozen=True)
class CanonicalJoint:
    """A canonical joint as a point (3,) fixed in the frame of one joint of the tree."""

    joint: int
    local: FloatArray


def canonical_frames(
    tree: JointTree,
    pose: Pose,
    *,
    unit: float | None,
    rate: float,
    source: str,
    detect_up: bool,
    notes: tuple[str, ...] = (),
) -> SensorFrames:
    """Sensors, joints and rest skeleton of a tree in motion.

    pose: of every frame, in the file's axes and units. unit: metres of one, None to guess it from the size of the body.
    detect_up: whether the frames may overrule the rest pose about which axis is up. Raises InputError if the tree is no
    human.
    """
    joints, found_notes = canonical_joints(tree, where=source)
    rest = rest_joint_positions(tree, joints)
    in_file_units = Skeleton(tuple(rest), np.stack(list(rest.values())))
    metres, unit_note = (unit, "") if unit is not None else choose_unit(stature(in_file_units), where=source)
    body = rest_axes(rest, where=source)
    if body is None:
        raise InputError(REST_AXES_ERROR, where=source, next_step="Export the file with a standing rest pose")
    tracks = {name: pose.point(at.joint, at.local) for name, at in joints.items()}
    world, axis_notes = world_axes(body, tracks) if detect_up else (axes_with_up(body[2]), ())

    names = tuple(name for name in JOINTS if name in joints)
    position = matmul(np.stack([tracks[name] for name in names], axis=1), world.T) * metres
    sensors = tuple(name for name in SENSORS if name in joints)
    columns = [names.index(name) for name in sensors]
    orientation = np.stack([pose.orientation[:, segment_joint(tree, joints, name)] for name in sensors], axis=1)
    skeleton = Skeleton(names, matmul(np.stack([rest[name] for name in names]), body.T) * metres)
    # World <- file axes <- segment <- its rest pose, facing x <- hanging.
    left, right = rotations.from_matrix(world), rotations.from_matrix(body.T)
    right = rotations.multiply(right, limb_turns(skeleton, sensors))
    orientation = rotations.normalise(rotations.multiply(rotations.multiply(left, orientation), right))
    return SensorFrames(
        time=frame_times(len(position), rate),
        names=sensors,
        position=position[:, columns],
        orientation=orientation,
        valid=np.ones((len(position), len(sensors)), bool),
        joints=JointTracks(names, position),
        skeleton=skeleton,
        source=source,
        rate_hz=rate,
        notes=(*notes, *((unit_note,) if unit_note else ()), *axis_notes, *found_notes),
    )


_SEGMENT_OF = {"wrist": "elbow", "ankle": "knee", "toe": "knee"}
"""At rest a hand is turned as the forearm, and a foot as the shank, by the joint where that begins."""
_DOWN = np.array([0.0, 0.0, -1.0])
"""Unit vector, world."""


def limb_turns(skeleton: Skeleton, sensors: tuple[str, ...]) -> FloatArray:
    """Turns (k, 4) wxyz of the segments of sensors from hanging straight down to the skeleton's rest pose, the shortest
    way (thumbs stay forward in a T-pose); the identity for those of the trunk, NaN for a bone without length."""
    result = np.tile(rotations.IDENTITY, (len(sensors), 1))
    for row, sensor in enumerate(sensors):
        side, part = sensor[:2], sensor[2:]
        near = _SEGMENT_OF.get(part, part)
        if near in _SEGMENT_END:
            along = skeleton.of(side + _SEGMENT_END[near]) - skeleton.of(side + near)
            result[row] = rotations.shortest_arc(_DOWN, along)
    return result


def canonical_joints(tree: JointTree, *, where: str) -> tuple[dict[str, CanonicalJoint], tuple[str, ...]]:
    """Canonical joints of a tree, by name tables or else by shape, and notes. Raises InputError if neither fits."""
    notes: list[str] = []
    found = joints_by_name(tree.names)
    if found is None or not _is_body(tree, found):
        found = joints_by_shape(tree)
        notes.append("joint names not known: the body was recognised by the shape of its skeleton")
    if found is None or not _is_body(tree, found):
        if missing := missing_joints(tree.names):
            raise InputError(
                "the body lacks joints that are needed",
                where=where,
                found="no " + ", ".join(f"{joint} ({name})" for joint, name in missing.items()),
                allowed="a body with head, two arms and two legs",
                next_step="Export the whole body, or rename the joints that are these",
            )
        raise InputError(
            "no human skeleton recognised",
            where=where,
            found=", ".join(tree.names[:12]) + (", ..." if len(tree.names) > 12 else ""),
            allowed="a body with head, two arms and two legs",
            next_step="Rename the joints to Hips, LeftUpLeg, LeftArm and so on (docs/motion-files.md)",
        )
    joints = {name: CanonicalJoint(joint, np.zeros(3)) for name, joint in found.items() if name in JOINTS}
    _add_trunk(tree, joints)
    if not _centre_head(tree, joints, found.get("head_top")):
        notes.append("the file has no top of the head: its head sensor is the head joint")
    for side in "lr":
        _add_toe(tree, joints, side)
    return joints, tuple(notes)


def _is_body(tree: JointTree, found: dict[str, int]) -> bool:
    """Whether the joints hang on each other as they do in a body."""
    limbs = [("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist")]
    chains = [["pelvis", *(f"{side}_{part}" for part in limb)] for side in "lr" for limb in limbs]
    for chain in [*chains, ["pelvis", "head"]]:
        path = tree.path(found[chain[-1]])
        places = [path.index(found[name]) if found[name] in path else -1 for name in chain]
        if places[0] < 0 or any(a >= b for a, b in pairwise(places)):
            return False
    return True


def rest_joint_positions(tree: JointTree, joints: dict[str, CanonicalJoint]) -> dict[str, FloatArray]:
    """Rest positions (3,) of the canonical joints, in the axes and the length unit of the file, pelvis at the
    origin."""
    rest = tree.rest_positions()
    origin = rest[joints["pelvis"].joint]
    return {name: rest[at.joint] + at.local - origin for name, at in joints.items()}


def segment_joint(tree: JointTree, joints: dict[str, CanonicalJoint], name: str) -> int:
    """Joint of the tree whose frame is the orientation of the sensor `name`."""
    side, part = name[:2], name[2:]
    if part == "toe":
        return joints[f"{side}ankle"].joint
    if part in _SEGMENT_END:
        return tree.parents[joints[side + _SEGMENT_END[part]].joint]
    return joints[name].joint


def _add_trunk(tree: JointTree, joints: dict[str, CanonicalJoint]) -> None:
    """Chest, spine and neck, as far as the tree has joints for them."""
    shared = shared_path(tree, [joints[name].joint for name in ("head", "l_shoulder", "r_shoulder")])
    above = tree.path(joints["head"].joint)[len(shared) :]
    rest = tree.rest_positions()
    zero = np.zeros(3)
    if len(shared) > 1:
        joints["chest"] = CanonicalJoint(shared[-1], zero)
        between = shared[shared.index(joints["pelvis"].joint) + 1 : -1] if joints["pelvis"].joint in shared else []
        half = 0.5 * (rest[joints["pelvis"].joint] + rest[shared[-1]])
        if between:
            joints["spine"] = CanonicalJoint(min(between, key=lambda joint: norm(rest[joint] - half)), zero)
    if "neck" not in joints and above:
        joints["neck"] = CanonicalJoint(above[0], zero)


def _centre_head(tree: JointTree, joints: dict[str, CanonicalJoint], top: int | None) -> bool:
    """Move the head from its joint to half way to its top; False if the file has no top of the head."""
    head = joints["head"].joint
    if top is not None and tree.parents[top] == head:
        end = tree.offsets[top]
    else:
        ends = [end for end in tree.ends[head] if end.any()]
        if not ends:
            return False
        end = max(ends, key=norm)
    joints["head"] = replace(joints["head"], local=0.5 * end)
    return True


def _add_toe(tree: JointTree, joints: dict[str, CanonicalJoint], side: str) -> None:
    """Where the file has no toe joint: the end of the foot, wherever the chain below the ankle ends."""
    if f"{side}_toe" in joints:
        return
    joint = joints[f"{side}_ankle"].joint
    while children := tree.children(joint):
        joint = children[0]
    ends = [end for end in tree.ends[joint] if end.any()]
    if ends or joint != joints[f"{side}_ankle"].joint:
        joints[f"{side}_toe"] = CanonicalJoint(joint, ends[0] if ends else np.zeros(3))
