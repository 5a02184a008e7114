"""The rest skeleton of a joint tree in motion: its canonical joints, and the pose in which it stands.

The pose with all rotations zero is used if it is a standing body along an axis of the file, else the frame that stands
most upright, with straight limbs. Bones are rigid, so lengths are exact either way.

Joints that names do not give come from the tree: the pelvis is where legs and head part, the chest where neck and arms
part, the spine half way between them, and the toe the end of the foot.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import fsum

import numpy as np

from retarget import rotations
from retarget.arithmetic import arccos, dot, matmul, norm, norms
from retarget.errors import InputError
from retarget.frames import ANKLE, HEAD_CENTRE, JOINTS, Skeleton
from retarget.model.rest_skeleton import SEGMENT_END, hanging_toe, rest_faults
from retarget.sources.axes import UP_AXES, axis_name, forward_sign, world_axes
from retarget.sources.skeletons import (
    REQUIRED,
    Channel,
    JointPoses,
    JointTree,
    joints_by_name,
    joints_by_shape,
    named_in_part,
    shared_path,
)
from retarget.types import FloatArray

SAME_LENGTH = (0.7, 1.4)
"""Bounds of the ratio of a length in the frames to that at rest: raised or rounded shoulders stay within them."""
DIFFERENCES = 0.3
"""Median share of the offsets below which position channels are differences from them: absolute ones are about a bone's
length."""


def true_offsets(
    tree: JointTree, channels: Sequence[Sequence[Channel]], values: FloatArray
) -> tuple[JointTree, FloatArray, tuple[str, ...]]:
    """The tree and the channel values (T, d) with consistent offsets and position channels, and notes on corrections.

    Positions that are differences from the offsets get these added. Offsets that are zero, or unlike the positions in
    the frames, come from the frames. Positions of joints that only carry the body are ignored.
    """
    starts = np.cumsum([0, *map(len, channels)])
    columns = {
        joint: [(int(starts[joint]) + at, axis) for at, (kind, axis) in enumerate(own) if kind == "t"]
        for joint, own in enumerate(channels)
        if joint not in tree.path(tree.fork())
    }
    moved = {}  # joint -> its median position (3,) in the parent's frame
    for joint, own in columns.items():
        if own:
            moved[joint] = tree.offsets[joint].copy()
            for column, axis in own:
                moved[joint][axis] = np.median(values[:, column])
    ratios = {joint: norm(at) / norm(tree.offsets[joint]) for joint, at in moved.items() if tree.offsets[joint].any()}
    if ratios and float(np.median(list(ratios.values()))) < DIFFERENCES:
        values = values.copy()
        for joint in moved:
            for column, axis in columns[joint]:
                values[:, column] += tree.offsets[joint, axis]
        return tree, values, ("positions of joints are differences from their offsets: they are added to them",)
    low, high = SAME_LENGTH
    wrong = [joint for joint, at in moved.items() if at.any() and not low <= ratios.get(joint, 0.0) <= high]
    if not wrong:
        return tree, values, ()
    offsets = tree.offsets.copy()
    offsets[wrong] = [moved[joint] for joint in wrong]
    first = wrong[0]
    note = (
        f"bone lengths are taken from the frames where the offsets say otherwise ({tree.names[first]}: "
        f"{norm(tree.offsets[first]):.4g}, in the frames {norm(moved[first]):.4g}; {len(wrong)} in all)"
    )
    return replace(tree, offsets=offsets), values, (note,)


@dataclass(frozen=True)
class CanonicalJoint:
    """A canonical joint as a point (3,) fixed in the frame of one joint of the tree. lacking: the performer lacks that
    limb, and the point hangs at rest."""

    joint: int
    local: FloatArray
    lacking: bool = False


_ARM = ("shoulder", "elbow", "wrist")
_LIMBS = (("hip", "knee", "ankle"), _ARM)
HEAD_RISE = 0.053
"""Height of the head's centre above its joint, as a share of stature: 0.052 to 0.055 in skeletons with a top of the
head."""
LIMB_SHARE = 0.15
"""A chain longer than this share of the path from head to foot may be a limb: an arm has a third of it, bones of the
face a tenth."""


def canonical_joints(tree: JointTree, *, where: str) -> tuple[dict[str, CanonicalJoint], tuple[str, ...]]:
    """Canonical joints of a tree, by name or else by shape, and notes. Raises InputError."""
    notes: list[str] = []
    found = joints_by_name(tree.names)
    if found is None or not _is_body(tree, found):
        found, missing = named_in_part(tree.names)
        side = _armless_side(tree, found)
        if side:
            name = "left" if side == "l" else "right"
            notes.append(f"the body has no {name} arm: it is taken to hang at rest beside the trunk")
            found = {joint: at for joint, at in found.items() if joint not in _arm_of(side)}
        elif missing or not _is_body(tree, found):
            found = joints_by_shape(tree)
            notes.append("joint names not known: the body was recognised by the shape of its skeleton")
            if found is None or not _is_body(tree, found):
                raise _no_body(tree, missing, where=where)
    joints = {name: CanonicalJoint(joint, np.zeros(3)) for name, joint in found.items() if name in JOINTS}
    shared = shared_path(tree, [joints[name].joint for name in ("l_hip", "r_hip", "head")])
    joints["pelvis"] = CanonicalJoint(shared[-1], np.zeros(3))
    _add_trunk(tree, joints)
    if note := _centre_head(tree, joints, found.get("head_top")):
        notes.append(note)
    for side in "lr":
        _add_toe(tree, joints, side)
        if f"{side}_wrist" not in joints:
            _add_arm(tree, joints, side)
    return joints, tuple(notes)


def _is_body(tree: JointTree, found: Mapping[str, int], *, but: str = "") -> bool:
    """True if the joints hang on each other as in a body. but: a side whose arm is not checked."""
    trunk = shared_path(tree, [found[name] for name in ("l_hip", "r_hip", "head")])
    if not trunk:
        return False
    chains = [[f"{s}_{part}" for part in limb] for s in "lr" for limb in _LIMBS if limb is not _ARM or s != but]
    for chain in [*chains, ["head"]]:
        path = tree.path(found[chain[-1]])
        places = [path.index(at) if at in path else -1 for at in (trunk[-1], *(found[name] for name in chain))]
        if places[0] < 0 or any(a >= b for a, b in pairwise(places)):
            return False
    return True


def _armless_side(tree: JointTree, found: Mapping[str, int]) -> str:
    """The side without an arm; "" if the tree is no such body, or has a chain that may be the arm by another name."""
    missing = {joint for joint in REQUIRED if joint not in found}
    sides = [side for side in "lr" if missing and missing <= {f"{side}_{part}" for part in _ARM}]
    if not sides or not _is_body(tree, found, but=sides[0]):
        return ""
    others = {name: at for name, at in found.items() if name not in _arm_of(sides[0])}
    ends = [at for name, at in others.items() if name[2:] in ("ankle", "wrist") or name == "head"]
    paths = [tree.path(joint) for joint in range(len(tree.names))]
    known = {joint for at in others.values() for joint in paths[at]}
    known |= {joint for joint, path in enumerate(paths) if not set(ends).isdisjoint(path)}
    lengths = [norm(offset) for offset in tree.offsets]
    size = fsum(lengths[at] for end in ("head", "l_ankle") for at in paths[found[end]] if at not in paths[tree.fork()])
    longest = max(fsum(lengths[at] for at in path if at not in known) for path in paths)
    return sides[0] if longest < LIMB_SHARE * size else ""


def _arm_of(side: str) -> set[str]:
    return {f"{side}_{part}" for part in ("collar", *_ARM, "hand")}


def _no_body(tree: JointTree, missing: Mapping[str, str], *, where: str) -> InputError:
    if missing and 2 * len(missing) < len(REQUIRED):
        return InputError(
            "the body lacks joints that are needed",
            where=where,
            found="no " + ", ".join(f"{joint} ({name})" for joint, name in missing.items()),
            allowed="a body with head, two arms and two legs",
            next_step="Export the whole body, or rename the joints that are these",
        )
    return InputError(
        "no human skeleton recognised",
        where=where,
        found=", ".join(tree.names[:12]) + (", ..." if len(tree.names) > 12 else ""),
        allowed="a body with head, two arms and two legs",
        next_step="Rename the joints to Hips, LeftUpLeg, LeftArm and so on (docs/motion-files.md)",
    )


def rest_joint_positions(tree: JointTree, joints: Mapping[str, CanonicalJoint]) -> dict[str, FloatArray]:
    """Rest positions (3,) of the canonical joints in file axes and units, from the pelvis."""
    rest = tree.rest_positions()
    origin = rest[joints["pelvis"].joint]
    return {name: rest[at.joint] + at.local - origin for name, at in joints.items()}


def segment_joint(tree: JointTree, joints: Mapping[str, CanonicalJoint], name: str) -> int:
    """Joint of the tree whose frame is the orientation of the sensor `name`: of a split segment (twist joints) the far
    part."""
    side, part = name[:2], name[2:]
    if part == "toe":
        return joints[f"{side}ankle"].joint
    if part in SEGMENT_END and not joints[name].lacking:
        return tree.parents[joints[side + SEGMENT_END[part]].joint]
    return joints[name].joint


def _add_trunk(tree: JointTree, joints: dict[str, CanonicalJoint]) -> None:
    arms = [joints[name].joint for name in ("l_shoulder", "r_shoulder") if name in joints]
    shared = shared_path(tree, [joints["head"].joint, *arms])
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


def _centre_head(tree: JointTree, joints: dict[str, CanonicalJoint], top: int | None) -> str:
    """Move the head from its joint half way to its top, and return a note if the file has no top of the head. An end of
    length zero is replaced by the usual height along the neck."""
    head, note = joints["head"].joint, ""
    has_top = top is not None and tree.parents[top] == head
    end = tree.offsets[top] if has_top else max(tree.ends[head], key=norm, default=None)
    if end is None:
        return "the file has no top of the head: its head sensor is the head joint"
    centre = 0.5 * end
    if not end.any():
        note = "the file has no top of the head: a head of usual height is taken"
        bones = tree.path(head)[len(tree.path(joints["pelvis"].joint)) :]
        bones = [*bones, joints["l_knee"].joint, joints["l_ankle"].joint]
        height = fsum(norm(tree.offsets[joint]) for joint in bones) / (HEAD_CENTRE - ANKLE - HEAD_RISE)
        neck = tree.offsets[head]
        centre = HEAD_RISE * height / max(norm(neck), 1e-12) * neck
    joints["head"] = replace(joints["head"], local=centre)
    return note


def _add_toe(tree: JointTree, joints: dict[str, CanonicalJoint], side: str) -> None:
    """Add the end of the foot as the toe of a file without toe joint."""
    if f"{side}_toe" in joints:
        return
    joint = joints[f"{side}_ankle"].joint
    while children := tree.children(joint):
        joint = children[0]
    ends = [end for end in tree.ends[joint] if end.any()]
    if ends or joint != joints[f"{side}_ankle"].joint:
        joints[f"{side}_toe"] = CanonicalJoint(joint, ends[0] if ends else np.zeros(3))


def _add_arm(tree: JointTree, joints: dict[str, CanonicalJoint], side: str) -> None:
    """Add the arm that the performer lacks: as long as the other one, hanging beside the trunk."""
    at, other = rest_joint_positions(tree, joints), "r" if side == "l" else "l"
    hips, across = 0.5 * (at["l_hip"] + at["r_hip"]), at["l_hip"] - at["r_hip"]
    up, shoulder = _direction(at["head"] - hips), at[f"{other}_shoulder"]
    point = shoulder - 2.0 * dot(shoulder - hips, across) / max(dot(across, across), 1e-12) * across
    bearer = joints.get("chest", joints["pelvis"])
    for part, above in zip(_ARM, ("", *_ARM), strict=False):
        length = norm(at[f"{other}_{part}"] - at[f"{other}_{above}"]) if above else 0.0
        point = point - length * up
        start = at[next(name for name in ("chest", "pelvis") if name in joints)]
        joints[f"{side}_{part}"] = CanonicalJoint(bearer.joint, point - start, lacking=True)


ALONG_AXIS = 0.97
"""Cosine (14 degrees) from which a rest direction is taken as an axis: the head of a straight body is up to 10 degrees
ahead."""
MAX_UPRIGHT_FRAMES = 2000
"""Most frames among which the most upright is searched: one per 0.8 s of 28 minutes."""


@dataclass(frozen=True)
class RestSkeleton:
    """A tree in motion whose pose with all rotations zero is a standing body.

    tree, pose, joints: with this zero pose, in file axes and units. skeleton: the joints at rest in body axes, in file
    units. body, world (3, 3): forward, left and up as rows in file axes, of the rest pose and of the recording; the
    determinant of both is -1 if the file is mirrored.
    """

    tree: JointTree
    pose: JointPoses
    joints: dict[str, CanonicalJoint]
    skeleton: Skeleton
    body: FloatArray
    world: FloatArray
    notes: tuple[str, ...]

    def lacks_foot(self) -> list[str]:
        """Toes that are joints of the file without a length on the ground."""
        toes = [name for name in ("l_toe", "r_toe") if name in self.joints]
        return [name for name in toes if hanging_toe(self.skeleton, name[0]) is None]


def find_rest_skeleton(
    tree: JointTree, pose: JointPoses, *, up: FloatArray | None, rate: float, where: str
) -> RestSkeleton:
    """The rest skeleton of a tree in motion. up (3,): the user's up axis. rate: Hz, for notes.

    Raises InputError if the tree is no human, if it stands neither with all rotations zero nor in a frame, and if arms
    and legs disagree on left and right.
    """
    joints, notes = canonical_joints(tree, where=where)
    tracks = {name: pose.point(at.joint, at.local) for name, at in joints.items()}
    front = -1.0 if forward_sign(tracks) < 0.0 else 1.0
    body, skeleton = _as_body(tree, joints, front=front)
    faults = rest_faults(skeleton) or _unlike_frames(skeleton, tracks)
    if not faults and (cosine := float(np.abs(body[2]).max())) != 1.0:
        faults = (f"it leans {np.degrees(float(arccos(cosine))):.0f} degrees from every axis of the file",)
    declared = None if faults else body[2]
    world, axis_notes = world_axes(
        tracks, declared=declared, declared_by="the rest pose", default=UP_AXES["y"], chosen=up
    )
    rest = RestSkeleton(tree, pose, joints, skeleton, body, world, (*axis_notes, *notes))
    if faults or rest.lacks_foot():
        row = _most_upright(tracks, pose, joints, world)
        upright = _at_frame(rest, row, front=front, where=where)
        if not faults and len(upright.lacks_foot()) < len(rest.lacks_foot()):
            faults = ("its feet have no length on the ground",)
        if faults:
            fault = f"with all rotations zero {faults[0]}"
            _refuse_swapped(upright.skeleton, where=where)
            if wrong := rest_faults(upright.skeleton):
                raise InputError(
                    "the skeleton has no rest pose",
                    where=where,
                    found=f"{fault}; in the most upright frame ({row + 1}) {wrong[0]}",
                    allowed="a body that stands upright, or a recording in which it does",
                    next_step="Export it with a T-pose as its rest pose, or let the recording begin with one",
                )
            note = (
                f"the skeleton's rest pose is no body that stands ({fault}): the frame at {row / rate:.2f} s, the most "
                "upright one, is taken instead"
            )
            rest = replace(upright, notes=(*rest.notes, note))
    _refuse_swapped(rest.skeleton, where=where)
    if not (flat := rest.lacks_foot()):
        return rest
    kept = {name: at for name, at in rest.joints.items() if name not in flat}
    skeleton = Skeleton(tuple(kept), np.stack([rest.skeleton.of(name) for name in kept]))
    note = "the file's feet have no length on the ground: its toes are left out"
    return replace(rest, joints=kept, skeleton=skeleton, notes=(*rest.notes, note))


def _at_frame(rest: RestSkeleton, row: int, *, front: float, where: str) -> RestSkeleton:
    """The same motion with frame `row` as the zero pose."""
    tree, pose = rest.tree, rest.pose
    turn = pose.orientation[row]
    above = np.array([turn[parent] if parent >= 0 else rotations.IDENTITY for parent in tree.parents])
    ends = tuple(tuple(rotations.rotate(q, end) for end in ends) for q, ends in zip(turn, tree.ends, strict=True))
    tree = replace(tree, offsets=rotations.rotate(above, tree.offsets), ends=ends)
    pose = replace(pose, orientation=rotations.multiply(pose.orientation, rotations.conjugate(turn)))
    joints, _ = canonical_joints(tree, where=where)
    body, skeleton = _as_body(tree, joints, front=front, up=rest.world[2])
    return replace(rest, tree=tree, pose=pose, joints=joints, skeleton=skeleton, body=body)


def _as_body(
    tree: JointTree, joints: Mapping[str, CanonicalJoint], *, front: float, up: FloatArray | None = None
) -> tuple[FloatArray, Skeleton]:
    """Axes (3, 3) of the body in the zero pose, and the joints in them.

    up (3,): if known, else from hips to head. Left is the line across hips and shoulders, orthogonal to up. front: -1
    if the tree is mirrored.
    """
    at = rest_joint_positions(tree, joints)
    if up is None:
        up = _direction(at["head"] - 0.5 * (at["l_hip"] + at["r_hip"]))
    across = at["l_hip"] - at["r_hip"] + at["l_shoulder"] - at["r_shoulder"]
    left = _direction(across - dot(across, up) * up)
    axes = np.stack((front * np.cross(left, up), left, up)) + 0.0
    return axes, Skeleton(tuple(at), matmul(np.stack(list(at.values())), axes.T))


def _direction(vector: FloatArray) -> FloatArray:
    """Unit vector (3,) along another, rounded to a coordinate axis within ALONG_AXIS; NaN for zero."""
    length = norm(vector)
    if not length > 0.0:
        return np.full(3, np.nan)
    axis = UP_AXES[axis_name(vector)]
    return axis if dot(vector, axis) >= ALONG_AXIS * length else vector / length


def _refuse_swapped(skeleton: Skeleton, *, where: str) -> None:
    hips, shoulders = (skeleton.of(f"l_{part}") - skeleton.of(f"r_{part}") for part in ("hip", "shoulder"))
    if dot(hips, shoulders) < 0.0:
        raise InputError(
            "left and right are swapped between arms and legs: in the rest pose they run in opposite directions",
            where=where,
            next_step="Exchange the names of the left and the right arm (or leg) joints in the program that wrote it",
        )


def _unlike_frames(skeleton: Skeleton, tracks: Mapping[str, FloatArray]) -> tuple[str, ...]:
    """Faults of a rest skeleton whose shoulder or hip width is not that of the frames."""
    low, high = SAME_LENGTH
    found = []
    for part in ("shoulder", "hip"):
        here = skeleton.distance(f"l_{part}", f"r_{part}")
        seen = float(np.median(norms(tracks[f"l_{part}"] - tracks[f"r_{part}"])))
        if not low * here <= seen <= high * here:
            found.append(f"its {part}s are not as far apart as in the frames")
    return tuple(found)


def _most_upright(
    tracks: Mapping[str, FloatArray], pose: JointPoses, joints: Mapping[str, CanonicalJoint], world: FloatArray
) -> int:
    """The frame most like a rest pose: upright, looking ahead, legs straight, arms straight and hanging or out to the
    sides.

    tracks: canonical joints (T, 3) in file axes. Each line of the body costs 1 minus its cosine to its rest direction.
    Turns of head and chest away from their mean cost too.
    """
    rows = np.unique(np.linspace(0, len(pose.position) - 1, MAX_UPRIGHT_FRAMES).astype(int))
    at = {name: matmul(track[rows], world.T) for name, track in tracks.items()}
    up = np.array([0.0, 0.0, 1.0])
    hips = at["l_hip"] - at["r_hip"]
    left = _units(hips * np.array([1.0, 1.0, 0.0]))
    ahead = np.cross(left, up)
    middle = 0.5 * (at["l_hip"] + at["r_hip"])
    # The trunk and its heading carry every limb, so they count more.
    shoulders = at["l_shoulder"] - at["r_shoulder"]
    cost = 3.0 * _off(at["head"] - middle, up) + 3.0 * _off(shoulders, left) + _off(hips, left)
    held = [joints[name].joint for name in ("pelvis", "chest", "head") if name in joints]
    for below, above in pairwise(held):
        turn = rotations.multiply(rotations.conjugate(pose.orientation[rows, below]), pose.orientation[rows, above])
        turn = turn * np.where((turn * turn[0]).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
        usual = rotations.normalise(turn.mean(axis=0))
        cosine = (turn * usual).sum(axis=1)
        cost = cost + 2.0 * (1.0 - cosine * cosine)
    for s in "lr":
        cost = cost + _off(at[f"{s}_hip"] - at[f"{s}_knee"], up) + _off(at[f"{s}_knee"] - at[f"{s}_ankle"], up)
        arm, forearm = at[f"{s}_elbow"] - at[f"{s}_shoulder"], at[f"{s}_wrist"] - at[f"{s}_elbow"]
        aside = left if s == "l" else -left
        cost = cost + np.minimum(_off(arm, -up), _off(arm, aside)) + _off(forearm, _units(arm))
        if f"{s}_toe" in at:
            foot = at[f"{s}_toe"] - at[f"{s}_ankle"]
            cost = cost + 0.5 * _off(foot * np.array([1.0, 1.0, 0.0]), ahead)
    return int(rows[int(np.argmin(np.where(np.isfinite(cost), cost, np.inf)))])


def _units(vectors: FloatArray) -> FloatArray:
    """Unit vectors (T, 3); zero if there is no length."""
    length = norms(vectors)[:, None]
    return np.asarray(vectors / np.where(length > 0.0, length, 1.0))


def _off(vectors: FloatArray, direction: FloatArray) -> FloatArray:
    """1 minus the cosine between vectors (T, 3) and unit vectors, (T,)."""
    return np.asarray(1.0 - (_units(vectors) * direction).sum(axis=1))
