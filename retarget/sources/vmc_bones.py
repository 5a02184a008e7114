"""Forward kinematics over the bones of Unity's humanoid: from parent-relative poses to the world's.

For senders that tell bones only (VirtualMotionCapture, VSeeFace), and to check those that tell both. Rows are those of
`BODY_BONES`. The reference is the T-pose: there every rotation is the identity.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from retarget.human_dimensions import POINTS, HumanDimensions
from retarget.rotations import IDENTITY, FloatArray, from_axis_angle, multiply, rotate
from retarget.sources.stream_frame import StreamFrame
from retarget.sources.vmc_names import BODY_BONES

__all__ = ["OPTIONAL", "LocalBones", "local_bones", "merged", "t_pose_offsets", "world_positions", "world_rotations"]

OPTIONAL: tuple[str, ...] = (
    *("Chest", "UpperChest", "Neck"),
    *(f"{side}{part}" for part in ("Shoulder", "Toes") for side in ("Left", "Right")),
)
"""Bones that an avatar may lack (docs.unity3d.com, HumanTrait.RequiredBone); their children hang from their parents."""

_TRUNK = ("Hips", "Spine", "Chest", "UpperChest", "Neck", "Head")
_ARM = ("Shoulder", "UpperArm", "LowerArm", "Hand")
_LEG = ("UpperLeg", "LowerLeg", "Foot", "Toes")
_CHAINS = (
    _TRUNK,
    *(("UpperChest", *(side + part for part in _ARM)) for side in ("Left", "Right")),
    *(("Hips", *(side + part for part in _LEG)) for side in ("Left", "Right")),
)
_PARENT = {bone: parent for chain in _CHAINS for parent, bone in pairwise(chain)}
_ROW = {bone: row for row, bone in enumerate(BODY_BONES)}
_COLUMN = {f"bone://{bone}": row for row, bone in enumerate(BODY_BONES)}
_IS_OPTIONAL = np.array([bone in OPTIONAL for bone in BODY_BONES])


def _depth(bone: str) -> int:
    return 1 + _depth(_PARENT[bone]) if bone in _PARENT else 0


_LEVELS = tuple(
    (
        np.array([_ROW[bone] for bone in BODY_BONES if _depth(bone) == depth]),
        np.array([_ROW[_PARENT[bone]] for bone in BODY_BONES if _depth(bone) == depth]),
    )
    for depth in range(1, 1 + max(map(_depth, BODY_BONES)))
)
"""Rows of the bones of each depth, and of their parents: all bones of one depth are turned at once."""

_ARM_POINTS = ("collar", "shoulder", "elbow", "wrist")
_LEG_POINTS = ("hip", "knee", "ankle", "toe")
_PARENT_ROWS = np.array([_ROW[_PARENT[bone]] for bone in BODY_BONES[1:]])
_PRODUCTS = np.array([[multiply(a, b) for b in np.eye(4)] for a in np.eye(4)]).reshape(4, 16)
"""A quaternion a (4,) times this, as (4, 4), is the matrix by which a row b becomes the product a b: fewer and larger
steps than `multiply`, eight times a frame."""

_POINTS = {
    **dict(zip(_TRUNK, ("pelvis", "spine", "chest", "", "neck", "head"), strict=True)),
    **{
        side + bone: short + point
        for side, short in (("Left", "l_"), ("Right", "r_"))
        for bone, point in zip(_ARM + _LEG, _ARM_POINTS + _LEG_POINTS, strict=True)
    },
}
"""The point of our human where a bone begins; the upper chest begins where the chest does."""


@dataclass(frozen=True, slots=True, eq=False)
class LocalBones:
    """Bones relative to their parents, in the world's axes; NaN where not told.

    rotation (22, 4) wxyz and position (22, 3) m by `BODY_BONES`; root_rotation (4,), root_position (3,) of the avatar.
    """

    rotation: FloatArray
    position: FloatArray
    root_rotation: FloatArray
    root_position: FloatArray


def local_bones(frame: StreamFrame) -> LocalBones:
    """The bones of one frame that its sender vouches for."""
    poses = np.full((len(BODY_BONES) + 1, 7), np.nan)
    for index, name in enumerate(frame.names):
        row = len(BODY_BONES) if name == "root://root" else _COLUMN.get(name)
        if row is not None and frame.tracked[index]:
            poses[row, :3] = frame.position[index]
            poses[row, 3:] = frame.orientation[index]
    return LocalBones(poses[:-1, 3:], poses[:-1, :3], poses[-1, 3:], poses[-1, :3])


def merged(later: LocalBones, earlier: LocalBones) -> LocalBones:
    """What `later` tells, and for the rest what `earlier` did: for senders that split an avatar over datagrams."""
    return LocalBones(
        np.where(np.isnan(later.rotation), earlier.rotation, later.rotation),
        np.where(np.isnan(later.position), earlier.position, later.position),
        np.where(np.isnan(later.root_rotation), earlier.root_rotation, later.root_rotation),
        np.where(np.isnan(later.root_position), earlier.root_position, later.root_position),
    )


def world_rotations(bones: LocalBones) -> FloatArray:
    """World orientation (22, 4) wxyz of each bone's segment.

    A root that is not told is the identity, and so is an optional bone. A required bone that is not told is NaN, and
    all that hangs from it.
    """
    world = np.where(_IS_OPTIONAL[:, None] & np.isnan(bones.rotation), IDENTITY, bones.rotation)
    root = np.where(np.isnan(bones.root_rotation), IDENTITY, bones.root_rotation)
    world[0] = multiply(root, world[0])
    for rows, parents in _LEVELS:
        factors = (world[parents] @ _PRODUCTS).reshape(-1, 4, 4)
        world[rows] = (world[rows, None] @ factors)[:, 0]
    return world


def world_positions(bones: LocalBones, rotations: FloatArray, offsets: FloatArray | None = None) -> FloatArray:
    """World position (22, 3) m of the joint where each bone begins.

    rotations (22, 4): of `world_rotations`. offsets (22, 3) m, see `t_pose_offsets`: from parent to bone in the T-pose,
    used where the sender tells no position. An optional bone of which nothing is known begins where its parent does;
    any other is NaN, and all that hangs from it.
    """
    step = bones.position if offsets is None else np.where(np.isnan(bones.position), offsets, bones.position)
    absent = _IS_OPTIONAL & np.isnan(bones.rotation[:, 0]) & np.isnan(step[:, 0])
    step = np.where(absent[:, None], 0.0, step)
    world = np.empty_like(step)
    world[1:] = rotate(rotations[_PARENT_ROWS], step[1:])
    root = np.where(np.isnan(bones.root_rotation), IDENTITY, bones.root_rotation)
    world[0] = rotate(root, step[0]) + np.where(np.isnan(bones.root_position), 0.0, bones.root_position)
    for rows, parents in _LEVELS:
        world[rows] += world[parents]
    return world


def t_pose_offsets(person: HumanDimensions) -> FloatArray:
    """Offset (22, 3) m of each bone from its parent for a person's size, in the T-pose; the hips lie in the root."""
    offsets = np.zeros((len(BODY_BONES), 3))
    for bone, point in _POINTS.items():
        if point:
            offsets[_ROW[bone]] = person.offset[POINTS.index(point)]
    for side, quarter in (("Left", 0.5 * np.pi), ("Right", -0.5 * np.pi)):
        # The person's arms hang; in the T-pose they point sideward.
        rows = [_ROW[f"{side}LowerArm"], _ROW[f"{side}Hand"]]
        offsets[rows] = rotate(from_axis_angle((1.0, 0.0, 0.0), quarter), offsets[rows])
    return offsets
