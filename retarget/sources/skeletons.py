"""Skeletons as trees of joints: forward kinematics, and canonical joints by name (`skeletons.yaml`) or by shape."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import fsum
from pathlib import Path
from typing import Any

import numpy as np

from retarget import rotations
from retarget.arithmetic import norm, norms
from retarget.schema import strict_yaml
from retarget.types import FloatArray

REQUIRED = (
    "head",
    *(f"{side}_{part}" for part in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle") for side in "lr"),
)
"""Joints that a body needs. The pelvis is where legs and head part, whatever its name."""


def names_of_sides(section: Mapping[str, Any]) -> dict[str, Any]:
    """A section of `skeletons.yaml` with each entry of a side as two, `l_` and `r_`, and lists as tuples."""
    entries = {name: entry for name, entry in section.items() if name != "sides"}
    sided = [name for name, entry in entries.items() if "{s}" in str(entry)]
    found = {name: _with_word(entry, "") for name, entry in entries.items() if name not in sided}
    for side, word in zip("lr", section.get("sides", "lr"), strict=True):
        found |= {f"{side}_{name}": _with_word(entries[name], word) for name in sided}
    return found


def _with_word(entry: Any, word: str) -> Any:
    if isinstance(entry, str):
        return entry.replace("{s}", word)
    return tuple(_with_word(part, word) for part in entry)


TABLES: Mapping[str, Any] = strict_yaml.load(Path(__file__).with_name("skeletons.yaml")).data
"""Content of `skeletons.yaml`."""
STYLES: Mapping[str, dict[str, tuple[str, ...]]] = {
    style: names_of_sides(section) for style, section in TABLES["joints"].items()
}
"""Family of joint names -> canonical joint (and `head_top`) -> names, best first."""


def layout(section: Mapping[str, str]) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Names and parent indices (-1: none) from a table of names and parents."""
    names = tuple(section)
    return names, tuple(names.index(parent) if parent else -1 for parent in section.values())


SMPL_NAMES, SMPL_PARENTS = layout(TABLES["layouts"]["smpl"])
"""The 24 joints of SMPL; SMPL-H and SMPL-X share the first 22."""


def joints_by_name(names: tuple[str, ...]) -> dict[str, int] | None:
    """Canonical joint (and `head_top`) -> index, by the family that names the most; None if none fits."""
    found = [joints for _, joints in _matches(names) if set(REQUIRED) <= set(joints)]
    return max(found, key=len, default=None)


def named_in_part(names: tuple[str, ...]) -> tuple[dict[str, int], dict[str, str]]:
    """Joints by the family that names most of the required ones, completed from others; and the joints still missing,
    with their names in that family."""
    matches = sorted(_matches(names), key=lambda match: -len(set(REQUIRED) & set(match[1])))
    style, found = matches[0][0], dict(matches[0][1])
    for _, joints in matches[1:]:
        for joint, index in joints.items():
            if joint in REQUIRED and joint not in found and index not in found.values():
                found[joint] = index
    return found, {joint: STYLES[style][joint][0] for joint in REQUIRED if joint not in found}


MOST_PREFIXES = 5
"""Commonest prefixes of names that are tried."""


def _matches(names: tuple[str, ...]) -> list[tuple[str, dict[str, int]]]:
    """Each family with its joints that occur, for each common prefix."""
    plain = [re.sub(r"[\s._\-]", "", name.rsplit(":", 1)[-1]).lower() for name in names]
    words = {option for style in STYLES.values() for joint in REQUIRED for option in style.get(joint, ())}
    prefixes = Counter(name.removesuffix(word) for name in plain for word in words if name.endswith(word))
    found = []
    for prefix in dict.fromkeys(["", *(prefix for prefix, _ in prefixes.most_common(MOST_PREFIXES))]):
        index: dict[str, int] = {}
        for i, name in enumerate(plain):
            if name.startswith(prefix):
                index.setdefault(name.removeprefix(prefix), i)
        for style, joints in STYLES.items():
            known = {joint: [name for name in options if name in index] for joint, options in joints.items()}
            found.append((style, {joint: index[own[0]] for joint, own in known.items() if own}))
    return found


@dataclass(frozen=True)
class JointTree:
    """n joints, parents before children, joint 0 the root, in the axes and units of the file.

    parents (n): index, -1 for the root. offsets (n, 3): joint centre in the parent's frame. ends (n): of each joint,
    the ends (3,) of bones without a joint there (fingertips, top of the head).
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: FloatArray
    ends: tuple[tuple[FloatArray, ...], ...]

    def path(self, joint: int) -> list[int]:
        """Joints from the root to `joint`, both included."""
        path = [joint]
        while self.parents[path[-1]] >= 0:
            path.append(self.parents[path[-1]])
        return path[::-1]

    def children(self, joint: int) -> list[int]:
        """Joints directly below `joint`."""
        return [child for child, parent in enumerate(self.parents) if parent == joint]

    def fork(self) -> int:
        """The first joint with more than one child; joints above it only carry the body."""
        joint = 0
        while len(children := self.children(joint)) == 1:
            joint = children[0]
        return joint

    def rest_positions(self) -> FloatArray:
        """Joint centres (n, 3) with all rotations zero and the root at the origin, in file units."""
        position = np.zeros((len(self.names), 3))
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                position[joint] = position[parent] + self.offsets[joint]
        return position


@dataclass(frozen=True)
class JointPoses:
    """Position (T, n, 3) and orientation (T, n, 4) wxyz of every joint's frame."""

    position: FloatArray
    orientation: FloatArray

    def point(self, joint: int, local: FloatArray) -> FloatArray:
        """Track (T, 3) of a point (3,) fixed in a joint's frame."""
        if not local.any():
            return np.array(self.position[:, joint])
        return np.asarray(self.position[:, joint] + rotations.rotate(self.orientation[:, joint], local))


def forward_kinematics(tree: JointTree, local_rotation: FloatArray, translation: FloatArray) -> JointPoses:
    """Pose of every joint.

    local_rotation (T, n, 4): joint frame in the parent's frame. translation (T, n, 3) or (n, 3): joint centre in the
    parent's frame; for the root in the world.
    """
    frames, joints = local_rotation.shape[:2]
    translation = np.broadcast_to(translation, (frames, joints, 3))
    # Joint-major: the track of one joint is contiguous.
    position, orientation = np.empty((joints, frames, 3)), np.empty((joints, frames, 4))
    for joint, parent in enumerate(tree.parents):
        if parent < 0:
            position[joint], orientation[joint] = translation[:, joint], local_rotation[:, joint]
            continue
        position[joint] = position[parent] + rotations.rotate(orientation[parent], translation[:, joint])
        orientation[joint] = rotations.multiply(orientation[parent], local_rotation[:, joint])
    return JointPoses(position.swapaxes(0, 1), orientation.swapaxes(0, 1))


def tree_of_poses(names: tuple[str, ...], parents: tuple[int, ...], pose: JointPoses) -> JointTree:
    """The tree of posed joints (n) whose zero pose is unturned; offsets are medians over the frames."""
    offsets = np.zeros((len(names), 3))
    for joint, parent in enumerate(parents):
        if parent >= 0:
            bone = pose.position[:, joint] - pose.position[:, parent]
            own = rotations.rotate(rotations.conjugate(pose.orientation[:, parent]), bone)
            offsets[joint] = np.median(own, axis=0)
    return JointTree(names, parents, offsets, ((),) * len(names))


Channel = tuple[str, int]
"""One channel of a motion file: a translation along an axis 0, 1 or 2 ("t"), or a turn about it ("r")."""


def posed(
    tree: JointTree,
    channels: Sequence[Sequence[Channel]],
    values: FloatArray,
    *,
    degrees: bool = True,
    frames: FloatArray | None = None,
) -> JointPoses:
    """Forward kinematics of all frames of a motion file, in its axes and units.

    channels (n): of each joint, in the order of values (T, d); each turn is about the axes already turned. With frames
    (n, 4), turns are about the fixed axes of that frame.
    """
    local = np.broadcast_to(rotations.IDENTITY, (len(values), len(tree.names), 4)).copy()
    translation = np.broadcast_to(tree.offsets, (*local.shape[:2], 3)).copy()
    start = 0
    for joint, own in enumerate(channels):
        turns = [(column, axis) for column, (kind, axis) in enumerate(own, start) if kind == "r"]
        if turns:
            # Turns about fixed axes multiply in reverse order.
            columns, axes = zip(*(turns if frames is None else turns[::-1]), strict=True)
            angles = np.radians(values[:, columns]) if degrees else values[:, columns]
            local[:, joint] = rotations.from_euler(angles, axes)
        for column, (kind, axis) in enumerate(own, start):
            if kind == "t":
                translation[:, joint, axis] = values[:, column]
        start += len(own)
    if frames is not None:  # C q C^-1 turns the vector part of q by C
        local[..., 1:] = rotations.rotate(frames, local[..., 1:])
    return forward_kinematics(tree, local, translation)


MIN_SPREAD = 0.15
"""Least distance of paired leaves from the middle plane, as a share of the body's size."""
MIDDLE = 0.04
"""Greatest distance of a middle leaf (the head) from the middle plane, in the same share."""

STRAIGHT_UP = 0.8
"""Least cosine between the vertical and the line from the head joint to its top: eyes are below."""
SHOULDER = 0.1
"""Least distance of a shoulder from the middle plane, in the same share: nearer joints are collars."""


def joints_by_shape(tree: JointTree) -> dict[str, int] | None:
    """Canonical joint -> joint of the tree by its rest pose, without names; None if the tree does not look like a body.

    The leaves give the mirror plane. A middle leaf is the head, the lowest leaf of each side ends a leg, the farthest
    other one an arm. The two longest bones of a limb are its segments. Names give left and right, else the direction of
    the toes.
    """
    rest = tree.rest_positions()
    rest -= rest[tree.fork()]
    ends = {joint: max(own, key=norm, default=np.zeros(3)) for joint, own in enumerate(tree.ends)}
    leaves = {joint: rest[joint] + end for joint, end in ends.items() if joint not in tree.parents}
    size = max(map(norm, leaves.values()), default=0.0)
    if len(leaves) < 5 or not 0.0 < size < np.inf:
        return None
    side = _mirror_axis(np.stack(list(leaves.values())) / size)
    if side is None:
        return None
    across = {joint: float(point[side]) / size for joint, point in leaves.items()}
    middle = [joint for joint, off in across.items() if abs(off) < MIDDLE]
    if not middle:
        return None
    crown = max(middle, key=lambda joint: norm(leaves[joint]))
    up = max({0, 1, 2} - {side}, key=lambda axis: abs(float(leaves[crown][axis])))
    heights = {joint: float(point[up] * np.sign(leaves[crown][up])) for joint, point in leaves.items()}
    limbs = []
    for sign in (1.0, -1.0):
        own = {joint: heights[joint] for joint, off in across.items() if sign * off > MIDDLE}
        limbs.append(_limbs_of_side(tree, own, crown, np.abs(rest[:, side]) / size))
    first, second = limbs
    if first is None or second is None:
        return None
    rising = np.eye(3)[up] * np.sign(leaves[crown][up])
    left = _named_left(tree, first) - _named_left(tree, second)
    if left == 0.0:  # left is up x forward, the direction of the toes
        forward = 3 - side - up
        toes = fsum(_foot_reach(tree, limb["ankle"], forward) for limb in (first, second))
        left = float(np.cross(rising, np.eye(3)[forward] * np.sign(toes))[side])
    if left < 0:
        first, second = second, first
    joints = {f"l_{part}": joint for part, joint in first.items()}
    joints |= {f"r_{part}": joint for part, joint in second.items()}
    head = _head_below(tree, crown, middle, [joints["l_shoulder"], joints["r_shoulder"]])
    trunk = shared_path(tree, [joints["l_hip"], joints["r_hip"], crown])
    if not trunk or head in (trunk[-1], -1):
        return None
    joints["head"] = head
    rise = leaves[crown] - rest[head]
    is_top = crown != head and float(rise[up] * np.sign(leaves[crown][up])) >= STRAIGHT_UP * norm(rise)
    return joints | {"head_top": crown} if is_top else joints


_WORD = re.compile(r"[左右]|[A-Z]?[a-z]+|[A-Z]+(?![a-z])")


def _named_left(tree: JointTree, limbs: Mapping[str, int]) -> float:
    words = [word.lower() for joint in limbs.values() for word in _WORD.findall(tree.names[joint])]
    return fsum(TABLES["side_words"].get(word, 0) for word in words)


def _head_below(tree: JointTree, crown: int, middle: list[int], arms: list[int]) -> int:
    """The head joint: the first above the arms with head in its name; else the last that middle leaves (eyes, jaw)
    share; else the crown, or its parent if it is a mere end."""
    above = tree.path(crown)[len(shared_path(tree, [crown, *arms])) :]
    named = [joint for joint in above if re.search(r"head(?![a-z])", tree.names[joint], re.IGNORECASE)]
    if named:
        return named[0]
    faces = [joint for joint in middle if joint != crown and set(above) & set(tree.path(joint))]
    if faces:
        return shared_path(tree, [crown, max(faces, key=lambda joint: len(shared_path(tree, [crown, joint])))])[-1]
    return crown if any(end.any() for end in tree.ends[crown]) else tree.parents[crown]


def _mirror_axis(points: FloatArray) -> int | None:
    """The axis across which leaves (k, 3), in body sizes, mirror each other best; None if they spread along none."""
    best, best_error = None, 0.1
    for axis in range(3):
        spread = np.sort(np.abs(points[:, axis]))
        if spread[-4:].min() < MIN_SPREAD * 0.5 or spread[-1] < MIN_SPREAD:
            continue
        mirrored = points * np.where(np.arange(3) == axis, -1.0, 1.0)
        error = float(norms(points[:, None] - mirrored[None]).min(axis=1).mean())
        if error < best_error:
            best, best_error = axis, error
    return best


def _limbs_of_side(tree: JointTree, leaves: dict[int, float], head: int, across: FloatArray) -> dict[str, int] | None:
    """Six joints of one side. leaves: with their heights. across (n,): distance of each joint from the middle plane, in
    body sizes."""
    if len(leaves) < 2:
        return None
    foot = min(leaves, key=leaves.__getitem__)
    hip_branch = len(shared_path(tree, [foot, head]))
    arms = [leaf for leaf in leaves if len(shared_path(tree, [leaf, foot])) <= hip_branch]
    if not arms:
        return None
    hand = max(arms, key=lambda leaf: fsum(norm(tree.offsets[step]) for step in tree.path(leaf)[1:]))
    leg = _two_longest_bones(tree, tree.path(foot)[hip_branch:])
    above_trunk = tree.path(hand)[len(shared_path(tree, [hand, head])) :]
    shoulder = next((at for at, joint in enumerate(above_trunk) if across[joint] > SHOULDER), len(above_trunk))
    arm = _two_longest_bones(tree, above_trunk[shoulder:])
    if leg is None or arm is None:
        return None
    return dict(zip(("hip", "knee", "ankle", "shoulder", "elbow", "wrist"), (*leg, *arm), strict=True))


def _two_longest_bones(tree: JointTree, chain: list[int]) -> tuple[int, int, int] | None:
    """Start, middle and end of the two longest bones of a chain."""
    if len(chain) < 3:
        return None
    lengths = [norm(tree.offsets[joint]) for joint in chain[1:]]
    first, second = sorted(sorted(range(len(lengths)), key=lengths.__getitem__)[-2:])
    return (chain[first], chain[first + 1], chain[second + 1]) if lengths[first] > 0.0 else None


def _foot_reach(tree: JointTree, joint: int, axis: int) -> float:
    reach = 0.0
    while children := tree.children(joint):
        joint = children[0]
        reach += float(tree.offsets[joint][axis])
    return reach + fsum(float(end[axis]) for end in tree.ends[joint])


def shared_path(tree: JointTree, joints: list[int]) -> list[int]:
    """Joints from the root to the last common ancestor."""
    paths = [tree.path(joint) for joint in joints]
    return [step[0] for step in zip(*paths, strict=False) if len(set(step)) == 1]
