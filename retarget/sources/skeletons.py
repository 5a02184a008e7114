"""Skeletons as trees of joints: forward kinematics, and the canonical joints found by name.

The names are in `skeletons.yaml`.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os.path import commonprefix
from pathlib import Path
from typing import Any

import numpy as np

from retarget import rotations
from retarget.schema import strict_yaml
from retarget.types import FloatArray

REQUIRED = (
    "pelvis",
    "head",
    *(f"{side}_{part}" for part in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle") for side in "lr"),
)
"""Joints that a style must find before it counts."""


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


def plain_names(names: tuple[str, ...]) -> list[str]:
    """Joint names as they are compared with the tables."""
    plain = [re.sub(r"[\s._\-]", "", name.rsplit(":", 1)[-1]).lower() for name in names]
    shared = commonprefix([name for name in plain if name])  # noqa: RUF071 - characters are meant, no paths
    if len(shared) < 3 or len(plain) < 2:
        return plain
    return [name.removeprefix(shared) for name in plain]


def joints_by_name(names: tuple[str, ...]) -> dict[str, int] | None:
    """Canonical joint (and `head_top`) -> index in `names`, by the style that names the most; None if none fits."""
    plain = plain_names(names)
    index: dict[str, int] = {}
    for i, name in enumerate(plain):
        index.setdefault(name, i)
    found = [joints for names in STYLES.values() if set(REQUIRED) <= set(joints := _matched(names, index))]
    return max(found, key=len, default=None)


def _matched(names: Mapping[str, tuple[str, ...]], index: Mapping[str, int]) -> dict[str, int]:
    """The joints of one style that occur."""
    matches = {
        joint: next((index[name] for name in options if name in index), None) for joint, options in names.items()
    }
    joints = {joint: match for joint, match in matches.items() if match is not None}
    # The pelvis is the root whatever it is called (a Biped's own root carries no name of its own).
    joints.setdefault("pelvis", 0)
    return joints


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

    def rest_positions(self) -> FloatArray:
        """Joint centres (n, 3), in the length unit of the file, with all rotations zero and the root at the origin."""
        position = np.zeros((len(self.names), 3))
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                position[joint] = position[parent] + self.offsets[joint]
        return position


@dataclass(frozen=True)
class Pose:
    """World position (T, n, 3) and orientation (T, n, 4) wxyz of every joint's frame."""

    position: FloatArray
    orientation: FloatArray

    def point(self, joint: int, local: FloatArray) -> FloatArray:
        """World track (T, 3) of a point (3,) fixed in a joint's frame."""
        if not local.any():
            return np.array(self.position[:, joint])
        return np.asarray(self.position[:, joint] + rotations.rotate(self.orientation[:, joint], local))


def forward_kinematics(tree: JointTree, local_rotation: FloatArray, translation: FloatArray) -> Pose:
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
    return Pose(position.swapaxes(0, 1), orientation.swapaxes(0, 1))


Channel = tuple[str, int]
"""One value of a frame in a motion file: a translation along an axis 0, 1 or 2 ("t"), or a turn about it ("r")."""


def posed(
    tree: JointTree,
    channels: Sequence[Sequence[Channel]],
    values: FloatArray,
    *,
    degrees: bool = True,
    frames: FloatArray | None = None,
) -> Pose:
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


def shared_path(tree: JointTree, joints: list[int]) -> list[int]:
    """Joints from the root down to the last common ancestor."""
    paths = [tree.path(joint) for joint in joints]
    return [step[0] for step in zip(*paths, strict=False) if len(set(step)) == 1]
