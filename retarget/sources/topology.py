"""Finding a human in a joint tree without knowing a name: by symmetry, extent and bone lengths of its rest pose."""

from dataclasses import dataclass

import numpy as np

from retarget.rotations import FloatArray
from retarget.sources.tree import JointTree

__all__ = ["joints_by_shape"]

MIN_SPREAD = 0.15
"""Least distance of paired leaves from the middle plane, as a share of the body's size."""
MIDDLE = 0.04
"""Greatest distance of a middle leaf (the head) from the middle plane, as a share of the body's size."""

SHOULDER = 0.1
"""Least distance of a shoulder from the middle plane, as a share of the body's size: nearer joints are collars."""


@dataclass(frozen=True)
class _Leaf:
    """A leaf of the tree: its joint and the outermost point (3,) there, relative to the root."""

    joint: int
    point: FloatArray


@dataclass(frozen=True)
class _Stance:
    """How the rest pose stands: axis across the body, axis along it and the sign of up on it, size of the body."""

    side_axis: int
    up_axis: int
    up: float
    size: float


def joints_by_shape(tree: JointTree) -> dict[str, int] | None:
    """Canonical joint -> joint of the tree, or None if the tree does not look like a body.

    The mirror plane of the leaves gives the sides (left and right by the direction of the toes), the middle leaf
    farthest from the root is the head, the lowest leaf of each side ends a leg, the farthest other one an arm; the two
    longest bones of a limb are thigh and shank, or upper arm and forearm.
    """
    leaves = _leaves(tree)
    size = max((float(np.linalg.norm(leaf.point)) for leaf in leaves), default=0.0)
    if len(leaves) < 5 or not 0.0 < size < np.inf:
        return None
    side_axis = _mirror_axis(leaves, size)
    if side_axis is None:
        return None
    middle = [leaf for leaf in leaves if abs(leaf.point[side_axis]) < MIDDLE * size]
    if not middle:
        return None
    head = max(middle, key=lambda leaf: float(np.linalg.norm(leaf.point)))
    up_axis = max({0, 1, 2} - {side_axis}, key=lambda axis: abs(float(head.point[axis])))
    stance = _Stance(side_axis, up_axis, float(np.sign(head.point[up_axis])), size)

    limbs: dict[str, int] = {}
    for sign in (1.0, -1.0):
        own = [leaf for leaf in leaves if leaf.point[side_axis] * sign > MIDDLE * size]
        limb = _limbs_of_side(tree, own, head.joint, stance)
        if limb is None:
            return None
        limbs |= {f"{'+' if sign > 0 else '-'}{part}": joint for part, joint in limb.items()}
    left = _left_sign(tree, limbs, stance)
    sides = {("+" if left > 0 else "-"): "l_", ("-" if left > 0 else "+"): "r_"}
    joints = {sides[name[0]] + name[1:]: joint for name, joint in limbs.items()}
    trunk = _shared_path(tree, [joints["l_hip"], joints["r_hip"], head.joint])
    has_end = any(end.any() for end in tree.ends[head.joint])
    top = head.joint if has_end else tree.parents[head.joint]
    if not trunk or top in (trunk[-1], -1):
        return None
    joints |= {"pelvis": trunk[-1], "head": top}
    return joints if has_end else joints | {"head_top": head.joint}


def _leaves(tree: JointTree) -> list[_Leaf]:
    rest = tree.rest_positions()
    inner = set(tree.parents)
    leaves = []
    for joint in range(len(tree.names)):
        if joint in inner:
            continue
        end = max(tree.ends[joint], key=lambda end: float(np.linalg.norm(end)), default=np.zeros(3))
        leaves.append(_Leaf(joint, rest[joint] + end))
    return leaves


def _mirror_axis(leaves: list[_Leaf], size: float) -> int | None:
    """The axis across the plane in which the leaves mirror each other best; None if they spread along none."""
    points = np.stack([leaf.point for leaf in leaves])
    best, best_error = None, 0.1 * size
    for axis in range(3):
        spread = np.sort(np.abs(points[:, axis]))
        if spread[-4:].min() < MIN_SPREAD * size * 0.5 or spread[-1] < MIN_SPREAD * size:
            continue
        mirrored = points * np.where(np.arange(3) == axis, -1.0, 1.0)
        error = float(np.linalg.norm(points[:, None] - mirrored[None], axis=-1).min(axis=1).mean())
        if error < best_error:
            best, best_error = axis, error
    return best


def _limbs_of_side(tree: JointTree, leaves: list[_Leaf], head: int, stance: _Stance) -> dict[str, int] | None:
    """Hip, knee, ankle, shoulder, elbow and wrist of one side."""
    if len(leaves) < 2:
        return None
    foot = min(leaves, key=lambda leaf: stance.up * float(leaf.point[stance.up_axis]))
    hip_branch = len(_shared_path(tree, [foot.joint, head]))
    arms = [leaf for leaf in leaves if len(_shared_path(tree, [leaf.joint, foot.joint])) <= hip_branch]
    if not arms:
        return None
    hand = max(arms, key=lambda leaf: _path_length(tree, leaf.joint))
    leg = _two_longest_bones(tree, tree.path(foot.joint)[hip_branch:])
    rest = tree.rest_positions()
    above_trunk = tree.path(hand.joint)[len(_shared_path(tree, [hand.joint, head])) :]
    far = [abs(rest[joint][stance.side_axis]) > SHOULDER * stance.size for joint in above_trunk]
    arm = _two_longest_bones(tree, above_trunk[far.index(True) :] if True in far else [])
    if leg is None or arm is None:
        return None
    return dict(zip(("hip", "knee", "ankle", "shoulder", "elbow", "wrist"), (*leg, *arm), strict=True))


def _two_longest_bones(tree: JointTree, chain: list[int]) -> tuple[int, int, int] | None:
    """Start and end of the first, and end of the second, of the two longest bones of a chain."""
    if len(chain) < 3:
        return None
    lengths = [float(np.linalg.norm(tree.offsets[joint])) for joint in chain[1:]]
    first, second = sorted(sorted(range(len(lengths)), key=lengths.__getitem__)[-2:])
    return (chain[first], chain[first + 1], chain[second + 1]) if lengths[first] > 0.0 else None


def _left_sign(tree: JointTree, limbs: dict[str, int], stance: _Stance) -> float:
    """Sign of the side axis on the body's left: left = up x forward, forward being where the feet point."""
    forward_axis = 3 - stance.side_axis - stance.up_axis
    toes = 0.0
    for side in "+-":
        joint = limbs[f"{side}ankle"]
        while children := tree.children(joint):
            joint = children[0]
            toes += float(tree.offsets[joint][forward_axis])
        toes += sum(float(end[forward_axis]) for end in tree.ends[joint])
    forward, vertical = np.zeros(3), np.zeros(3)
    forward[forward_axis], vertical[stance.up_axis] = np.sign(toes), stance.up
    return float(np.cross(vertical, forward)[stance.side_axis]) or 1.0


def _shared_path(tree: JointTree, joints: list[int]) -> list[int]:
    """Joints from the root down to the last common ancestor."""
    paths = [tree.path(joint) for joint in joints]
    return [step[0] for step in zip(*paths, strict=False) if len(set(step)) == 1]


def _path_length(tree: JointTree, joint: int) -> float:
    return sum(float(np.linalg.norm(tree.offsets[step])) for step in tree.path(joint)[1:])
