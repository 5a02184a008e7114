"""One motion of one body, written by many rigs: which local axis bones lie along, what carries the hips, which way is
up, mirrored or not, in any unit. Every rig must be read as the plain one."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from retarget import rotations
from retarget.frames import SensorFrames
from retarget.sources.axes import axes_with_up
from retarget.sources.skeletons import JointPoses, JointTree, forward_kinematics
from retarget.types import FloatArray

FRAMES = 12
SIDES = ((1.0, "Left"), (-1.0, "Right"))


def tree_of(rows: Sequence[tuple[str, str, tuple[float, float, float]]], ends: Mapping[str, FloatArray]) -> JointTree:
    """The tree of joints, each with the name of its parent ("" of the root) and its offset (3,), and the ends (3,) of
    leaves."""
    names = tuple(name for name, _, _ in rows)
    return JointTree(
        names=names,
        parents=tuple(names.index(parent) if parent else -1 for _, parent, _ in rows),
        offsets=np.array([offset for _, _, offset in rows]),
        ends=tuple((ends[name],) if name in ends else () for name in names),
    )


def body(*, arms: Sequence[str] = ("Left", "Right"), toe: Sequence[float] = (0.0, -0.06, 0.13)) -> JointTree:
    """A person of 1.76 m in a T-pose, metres, y up, z forward. arms: the sides that have one. toe: from the ankle."""
    rows: list[tuple[str, str, tuple[float, float, float]]] = [("Hips", "", (0.0, 0.0, 0.0))]
    rows += [("Spine", "Hips", (0.0, 0.12, 0.0)), ("Chest", "Spine", (0.0, 0.24, 0.0))]
    rows += [("Neck", "Chest", (0.0, 0.14, 0.0)), ("Head", "Neck", (0.0, 0.09, 0.01))]
    ends = {"Head": np.array([0.0, 0.18, 0.0])}
    for sign, side in SIDES:
        if side in arms:
            rows += [(f"{side}Shoulder", "Chest", (0.03 * sign, 0.1, 0.0))]
            rows += [(f"{side}Arm", f"{side}Shoulder", (0.15 * sign, 0.01, 0.0))]
            rows += [(f"{side}ForeArm", f"{side}Arm", (0.28 * sign, 0.0, 0.0))]
            rows += [(f"{side}Hand", f"{side}ForeArm", (0.25 * sign, 0.0, 0.0))]
            ends[f"{side}Hand"] = np.array([0.17 * sign, 0.0, 0.0])
        rows += [(f"{side}UpLeg", "Hips", (0.09 * sign, -0.06, 0.0)), (f"{side}Leg", f"{side}UpLeg", (0.0, -0.42, 0.0))]
        rows += [(f"{side}Foot", f"{side}Leg", (0.0, -0.41, 0.0))]
        rows += [(f"{side}ToeBase", f"{side}Foot", (toe[0], toe[1], toe[2]))]
    return tree_of(rows, ends)


def moved(tree: JointTree) -> JointPoses:
    """The person stands with hanging arms, raises the left arm to the front, bends the right elbow and squats."""
    local = np.broadcast_to(rotations.IDENTITY, (FRAMES, len(tree.names), 4)).copy()
    share = np.clip(np.linspace(-0.2, 1.0, FRAMES), 0.0, 1.0)
    x, y, z = np.eye(3)

    def turn(joint: str, axis: FloatArray, degrees: FloatArray) -> None:
        if joint in tree.names:
            at = tree.names.index(joint)
            local[:, at] = rotations.multiply(local[:, at], rotations.from_axis_angle(axis, np.radians(degrees)))

    still = np.ones(FRAMES)
    turn("LeftArm", x, -80.0 * share)
    turn("LeftArm", z, -85.0 * still)
    turn("RightArm", z, 85.0 * still)
    turn("RightForeArm", y, 70.0 * share)
    turn("Head", y, 25.0 * np.sin(6.0 * share))
    turn("Spine", x, 20.0 * share)
    for _, side in SIDES:
        turn(f"{side}UpLeg", x, -60.0 * share)
        turn(f"{side}Leg", x, 80.0 * share)
        turn(f"{side}Foot", x, -20.0 * share)
    translation = np.broadcast_to(tree.offsets, (*local.shape[:2], 3)).copy()
    translation[:, 0] = np.array([3.0, 0.97, 2.0]) + share[:, None] * np.array([0.1, -0.2, -0.1])
    return forward_kinematics(tree, local, translation)


def along(tree: JointTree, pose: JointPoses, axis: FloatArray, noise: float) -> tuple[JointTree, JointPoses]:
    """The same motion of a rig in which every bone to a first child lies along a local axis (3,): its zero pose is a
    stick. noise: m, of the offsets."""
    frames = np.tile(rotations.IDENTITY, (len(tree.names), 1))
    for joint in range(len(tree.names)):
        bones = [tree.offsets[child] for child in tree.children(joint)] + list(tree.ends[joint])
        if tree.names[joint] == "Chest":
            bones = [tree.offsets[tree.names.index("Neck")]]
        parent = tree.parents[joint]
        frames[joint] = rotations.shortest_arc(axis, bones[0]) if bones else frames[parent]
    above = np.array([frames[parent] if parent >= 0 else rotations.IDENTITY for parent in tree.parents])
    offsets = rotations.rotate(rotations.conjugate(above), tree.offsets)
    offsets = offsets + noise * np.random.default_rng(1).normal(size=offsets.shape)
    ends = tuple(
        tuple(rotations.rotate(rotations.conjugate(q), end) for end in ends)
        for q, ends in zip(frames, tree.ends, strict=True)
    )
    return replace(tree, offsets=offsets, ends=ends), JointPoses(
        pose.position, rotations.multiply(pose.orientation, frames)
    )


def carried(tree: JointTree, pose: JointPoses, prefix: str, carriers: int) -> tuple[JointTree, JointPoses]:
    """The same motion with so many joints on the floor above the hips, and a prefix on every name."""
    names = (*(f"{prefix}Root{i}" for i in range(carriers)), *(prefix + name for name in tree.names))
    offsets = np.concatenate((np.zeros((carriers, 3)), tree.offsets))
    offsets[carriers] = np.array([0.0, 0.97, 0.0]) if carriers else offsets[carriers]
    shape = (len(pose.position), carriers)
    return (
        JointTree(
            names=names,
            parents=(*range(-1, carriers), *(parent + carriers for parent in tree.parents[1:])),
            offsets=offsets,
            ends=((),) * carriers + tree.ends,
        ),
        JointPoses(
            np.concatenate((np.zeros((*shape, 3)), pose.position), axis=1),
            np.concatenate((np.broadcast_to(rotations.IDENTITY, (*shape, 4)), pose.orientation), axis=1),
        ),
    )


def rest_turned(tree: JointTree, pose: JointPoses, turn: FloatArray) -> tuple[JointTree, JointPoses]:
    """The same motion of a rig whose zero pose is turned as a whole, by a quaternion (4,)."""
    ends = tuple(tuple(rotations.rotate(turn, end) for end in ends) for ends in tree.ends)
    orientation = rotations.multiply(pose.orientation, rotations.conjugate(turn))
    return replace(tree, offsets=rotations.rotate(turn, tree.offsets), ends=ends), JointPoses(
        pose.position, orientation
    )


def in_axes(
    tree: JointTree, pose: JointPoses, up: FloatArray, *, mirrored: bool, heading: float, unit: float
) -> tuple[JointTree, JointPoses]:
    """The same motion in a file with another up axis (3,), heading (rad), handedness and length unit (m)."""
    to_world, to_file = axes_with_up(np.array([0.0, 1.0, 0.0])), axes_with_up(up).T
    about = rotations.to_matrix(rotations.from_axis_angle([0.0, 0.0, 1.0], heading))
    flip = np.diag([1.0, 1.0, -1.0 if mirrored else 1.0])  # of the body's rig, which is y up and faces z
    turn = rotations.from_matrix(to_file @ about @ to_world)
    signs = np.array([1.0, -1.0, -1.0, 1.0]) if mirrored else np.ones(4)
    rest = np.eye(3) if heading else to_file @ to_world  # a rest pose turns with the axes, not with the heading
    q = rotations.from_matrix(rest)
    orientation = rotations.multiply(rotations.multiply(turn, pose.orientation * signs), rotations.conjugate(q))
    ends = tuple(tuple(rest @ flip @ end / unit for end in ends) for ends in tree.ends)
    return (
        replace(tree, offsets=tree.offsets @ (rest @ flip).T / unit, ends=ends),
        JointPoses(pose.position @ (rotations.to_matrix(turn) @ flip).T / unit, orientation),
    )


def differences(found: SensorFrames, right: SensorFrames) -> tuple[float, float]:
    """Greatest distance (mm) of a joint and angle (degrees) of a sensor between two readings of one motion, after one
    turn about the vertical and one shift on the ground."""
    assert found.joints is not None and right.joints is not None
    names = [name for name in right.joints.names if name in found.joints.names]
    assert len(names) >= len(right.joints.names) - 2
    p, q = (np.stack([one.joints.of(name) for name in names], axis=1) for one in (found, right))  # type: ignore[union-attr]
    p, q = (at - at.mean(axis=(0, 1)) * [1.0, 1.0, 0.0] for at in (p, q))
    h = np.einsum("tni,tnj->ij", p, q)
    angle = float(np.arctan2(h[0, 1] - h[1, 0], h[0, 0] + h[1, 1]))
    yaw = rotations.from_axis_angle([0.0, 0.0, 1.0], angle)
    far = np.linalg.norm(rotations.rotate(yaw, p) - q, axis=-1).max()
    turned = rotations.multiply(yaw, found.orientation)
    columns = [right.index(name) for name in found.names]
    off = rotations.angle_between(turned, right.orientation[:, columns]).max()
    return 1000.0 * float(far), float(np.degrees(off))
