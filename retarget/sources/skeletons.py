"""Skeletons as trees of joints: forward kinematics, and the canonical joints found by name or by shape.

The names are in `skeletons.yaml`.
"""

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
"""Joints that a style must find before it counts. The pelvis is where legs and head part, whatever it is called."""


def names_of_sides(section: Mapping[str, Any]) -> dict[str, Any]:
    """A section of `skeletons.yaml` with each entry of a side as two, `l_` and `r_`, and lists as tuples."""
    entries = {name: entry for name, entry in section.items() if name != "sides"}
    sided = [name for name, entry in entries.items() if "{s}" in str(entry)]
    found = {name: _with_word(entry, "") for name, entry in entries.items() if name not in sided}
    for side, word in zip("lr", section.get("sides", "lr"), strict=True):
        found |= {f"{side}_{name}": _with_word(entries[name], word) for name in sided}
    return found


def _with_word(entry: Any, word: str) -> Any:
    """Names, in lists of any depth, with the word of a side in place of {s}."""
    if isinstance(entry, str):
        return entry.replace("{s}", word)
    return tuple(_with_word(part, word) for part in entry)


TABLES: Mapping[str, Any] = strict_yaml.load(Path(__file__).with_name("skeletons.yaml")).data
"""Section of `skeletons.yaml` -> its content."""
STYLES: Mapping[str, dict[str, tuple[str, ...]]] = {
    style: names_of_sides(section) for style, section in TABLES["joints"].items()
}
"""Family of joint names -> canonical joint (and `head_top`) -> names, best first."""


def layout(section: Mapping[str, str]) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Names and indices of parents (-1: none) of joints, from a table of names and their parents."""
    names = tuple(section)
    return names, tuple(names.index(parent) if parent else -1 for parent in section.values())


SMPL_NAMES, SMPL_PARENTS = layout(TABLES["layouts"]["smpl"])
"""The 24 joints of SMPL, of which SMPL-H and SMPL-X have the first 22."""


def joints_by_name(names: tuple[str, ...]) -> dict[str, int] | None:
    """Canonical joint (and `head_top`) -> index in `names`, by the style that names the most; None if none fits."""
    found = [joints for _, joints in _matches(names) if set(REQUIRED) <= set(joints)]
    return max(found, key=len, default=None)


def named_in_part(names: tuple[str, ...]) -> tuple[dict[str, int], dict[str, str]]:
    """Where no style names all: the joints of the style that names most of those that are needed, with what it lacks
    taken from others; and canonical joint -> its name in that style, for those that no style finds."""
    matches = sorted(_matches(names), key=lambda match: -len(set(REQUIRED) & set(match[1])))
    style, found = matches[0][0], dict(matches[0][1])
    for _, joints in matches[1:]:
        for joint, index in joints.items():
            if joint in REQUIRED and joint not in found and index not in found.values():
                found[joint] = index
    return found, {joint: STYLES[style][joint][0] for joint in REQUIRED if joint not in found}


MOST_PREFIXES = 5
"""Prefixes of names that are tried: the commonest."""


def _matches(names: tuple[str, ...]) -> list[tuple[str, dict[str, int]]]:
    """Each style with the joints of it that occur, by each prefix that the names of a skeleton may have: other joints
    of the file need not have it."""
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


# A skeleton as a tree of joints, and its forward kinematics over all frames at once.
#
# The common form of ASF and BVH: a joint turns everything below it, and its offset is constant in its parent's frame.
# Axes and units are those of the file.


@dataclass(frozen=True)
class JointTree:
    """n joints, parents before children, joint 0 the root.

    names (n): as in the file. parents (n): index, -1 for the root. offsets (n, 3): joint centre in the parent joint's
    frame. ends (n): for each joint the ends of bones that have no joint there (leaves: fingertip, top of the head),
    each (3,).
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
        """The first joint from the root on that carries more than one bone: what is above only carries the body."""
        joint = 0
        while len(children := self.children(joint)) == 1:
            joint = children[0]
        return joint

    def rest_positions(self) -> FloatArray:
        """Joint centres (n, 3), in the length unit of the file, with all rotations zero and the root at the origin."""
        position = np.zeros((len(self.names), 3))
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                position[joint] = position[parent] + self.offsets[joint]
        return position


@dataclass(frozen=True)
class JointPoses:
    """World position (T, n, 3) and orientation (T, n, 4) wxyz of every joint's frame."""

    position: FloatArray
    orientation: FloatArray

    def point(self, joint: int, local: FloatArray) -> FloatArray:
        """World track (T, 3) of a point (3,) fixed in a joint's frame."""
        if not local.any():
            return np.array(self.position[:, joint])
        return np.asarray(self.position[:, joint] + rotations.rotate(self.orientation[:, joint], local))


def forward_kinematics(tree: JointTree, local_rotation: FloatArray, translation: FloatArray) -> JointPoses:
    """World pose of every joint.

    local_rotation (T, n, 4): joint frame in the parent's frame. translation (T, n, 3) or (n, 3): joint centre in the
    parent's frame (the root's: in the world); usually `tree.offsets` with the root's track.
    """
    frames, joints = local_rotation.shape[:2]
    translation = np.broadcast_to(translation, (frames, joints, 3))
    # Joint-major, so that one joint's track is contiguous.
    position, orientation = np.empty((joints, frames, 3)), np.empty((joints, frames, 4))
    for joint, parent in enumerate(tree.parents):
        if parent < 0:
            position[joint], orientation[joint] = translation[:, joint], local_rotation[:, joint]
            continue
        position[joint] = position[parent] + rotations.rotate(orientation[parent], translation[:, joint])
        orientation[joint] = rotations.multiply(orientation[parent], local_rotation[:, joint])
    return JointPoses(position.swapaxes(0, 1), orientation.swapaxes(0, 1))


def tree_of_poses(names: tuple[str, ...], parents: tuple[int, ...], pose: JointPoses) -> JointTree:
    """The tree whose zero pose has every frame unturned, of joints (n) in poses: an offset is the median over all
    frames."""
    offsets = np.zeros((len(names), 3))
    for joint, parent in enumerate(parents):
        if parent >= 0:
            apart = pose.position[:, joint] - pose.position[:, parent]
            offsets[joint] = np.median(
                rotations.rotate(rotations.conjugate(pose.orientation[:, parent]), apart), axis=0
            )
    return JointTree(names, parents, offsets, ((),) * len(names))


Channel = tuple[str, int]
"""One value of a frame in a motion file: a translation along an axis 0, 1 or 2 ("t"), or a turn about it ("r")."""


def posed(
    tree: JointTree,
    channels: Sequence[Sequence[Channel]],
    values: FloatArray,
    *,
    degrees: bool = True,
    frames: FloatArray | None = None,
) -> JointPoses:
    """Compute the forward kinematics of all frames of a motion file, in its axes and its length unit.

    channels (n): of each joint, in the order of values (T, d); each turn is about the axes already turned. With
    frames (n, 4), each is about fixed axes, those of its joint.
    """
    local = np.broadcast_to(rotations.IDENTITY, (len(values), len(tree.names), 4)).copy()
    translation = np.broadcast_to(tree.offsets, (*local.shape[:2], 3)).copy()
    start = 0
    for joint, own in enumerate(channels):
        turns = [(column, axis) for column, (kind, axis) in enumerate(own, start) if kind == "r"]
        if turns:
            # About fixed axes, the first turn is applied first: the product runs the other way.
            columns, axes = zip(*(turns if frames is None else turns[::-1]), strict=True)
            angles = np.radians(values[:, columns]) if degrees else values[:, columns]
            local[:, joint] = rotations.from_euler(angles, axes)
        for column, (kind, axis) in enumerate(own, start):
            if kind == "t":
                translation[:, joint, axis] = values[:, column]
        start += len(own)
    if frames is not None:  # C q C^-1 has the vector part of q turned by C
        local[..., 1:] = rotations.rotate(frames, local[..., 1:])
    return forward_kinematics(tree, local, translation)


# Finding a human in a joint tree without knowing a name: by symmetry, extent and bone lengths of its rest pose.

MIN_SPREAD = 0.15
"""Least distance of paired leaves from the middle plane, as a share of the body's size."""
MIDDLE = 0.04
"""Greatest distance of a middle leaf (the head) from the middle plane, as a share of the body's size."""

STRAIGHT_UP = 0.8
"""Least cosine between the vertical and the line from the head's joint to a leaf that is its top, and no eye."""
SHOULDER = 0.1
"""Least distance of a shoulder from the middle plane, as a share of the body's size: nearer joints are collars."""


def joints_by_shape(tree: JointTree) -> dict[str, int] | None:
    """Canonical joint -> joint of the tree, or None if the tree does not look like a body.

    The mirror plane of the leaves gives the sides: left and right by their names where those say it, else by the
    direction of the toes. A middle leaf is the head, the lowest leaf of each side ends a leg, the farthest other one an
    arm; the two longest bones of a limb are thigh and shank, or upper arm and forearm. All is measured from the fork of
    the body: what carries it (a root on the floor) does not count.
    """
    rest = tree.rest_positions()
    rest -= rest[tree.fork()]
    # The outermost point (3,) of each leaf, relative to the fork.
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
    left = _named_left(tree, first) - _named_left(tree, second) or _pointed_left(tree, (first, second), rising, side)
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


SIDE_WORDS = {
    1: "l left links linker linke linkes gauche izquierda izquierdo izq sinistra sinistro sx esquerda esquerdo lewa",
    -1: "r right rechts rechter rechte rechtes droite droit derecha derecho destra destro dx direita direito prawa",
}
"""Words in names of joints that are 1: of the left, -1: of the right."""
_SIDE_OF = {word: side for side, words in SIDE_WORDS.items() for word in words.split()} | {"左": 1, "右": -1}
"""Each of them, and the signs for left and right, -> 1 or -1."""
_WORD = re.compile(r"[左右]|[A-Z]?[a-z]+|[A-Z]+(?![a-z])")


def _named_left(tree: JointTree, limbs: Mapping[str, int]) -> float:
    """How many more joints of these limbs are named as of the left than as of the right."""
    words = [word.lower() for joint in limbs.values() for word in _WORD.findall(tree.names[joint])]
    return fsum(_SIDE_OF.get(word, 0) for word in words)


def _pointed_left(tree: JointTree, limbs: Sequence[Mapping[str, int]], rising: FloatArray, side: int) -> float:
    """Above 0 where the first limbs are the left ones: left is up (rising, (3,)) x forward, where the feet point. side:
    the axis across the body."""
    forward = 3 - side - int(np.argmax(np.abs(rising)))
    toes = fsum(_toes(tree, limb["ankle"], forward) for limb in limbs)
    return float(np.cross(rising, np.eye(3)[forward] * np.sign(toes))[side])


def _head_below(tree: JointTree, crown: int, middle: list[int], arms: list[int]) -> int:
    """The head's joint: the one that is called so on the way to the farthest middle leaf (the crown); else the last
    joint that several middle leaves share (eyes, jaw); else the leaf, or what carries it where it is a mere end."""
    above = tree.path(crown)[len(shared_path(tree, [crown, *arms])) :]
    named = [joint for joint in above if re.search(r"head(?![a-z])", tree.names[joint], re.IGNORECASE)]
    if named:
        return named[0]
    faces = [joint for joint in middle if joint != crown and set(above) & set(tree.path(joint))]
    if faces:
        return shared_path(tree, [crown, max(faces, key=lambda joint: len(shared_path(tree, [crown, joint])))])[-1]
    return crown if any(end.any() for end in tree.ends[crown]) else tree.parents[crown]


def _mirror_axis(points: FloatArray) -> int | None:
    """The axis across the plane in which leaves (k, 3), in sizes of the body, mirror each other best; None if they
    spread along none."""
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
    """Hip, knee, ankle, shoulder, elbow and wrist of one side. leaves: its own, with their heights. across (n,): how
    far each joint is from the middle plane, in sizes of the body."""
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
    """Start and end of the first, and end of the second, of the two longest bones of a chain."""
    if len(chain) < 3:
        return None
    lengths = [norm(tree.offsets[joint]) for joint in chain[1:]]
    first, second = sorted(sorted(range(len(lengths)), key=lengths.__getitem__)[-2:])
    return (chain[first], chain[first + 1], chain[second + 1]) if lengths[first] > 0.0 else None


def _toes(tree: JointTree, joint: int, axis: int) -> float:
    """How far along an axis the end of a foot is from its ankle."""
    way = 0.0
    while children := tree.children(joint):
        joint = children[0]
        way += float(tree.offsets[joint][axis])
    return way + fsum(float(end[axis]) for end in tree.ends[joint])


def shared_path(tree: JointTree, joints: list[int]) -> list[int]:
    """Joints from the root down to the last common ancestor."""
    paths = [tree.path(joint) for joint in joints]
    return [step[0] for step in zip(*paths, strict=False) if len(set(step)) == 1]
