"""The rest pose of a NatNet skeleton: the offsets of its definition, added up from bone to bone."""

import numpy as np

from retarget.frames import Skeleton
from retarget.rotations import FloatArray
from retarget.sources.naming import joints_by_name
from retarget.sources.natnet_models import BodyDefinition, GroupDefinition
from retarget.sources.stream_axes import Convention

__all__ = ["rest_skeleton"]


def rest_skeleton(group: GroupDefinition, axes: Convention) -> Skeleton | None:
    """The canonical joints of a skeleton in its T-pose, facing x; None where names or parents make no human.

    In that pose no bone is turned, so each offset, which is told in its parent's frame, adds to the parent's place.
    Which way a T-pose faces in the lab is not told: from the right hip to the left one is left.
    """
    bones = {bone.number & 0xFFFF: bone for bone in group.bones}
    prefix = f"{group.name}_"
    joints = joints_by_name(tuple(bone.name.removeprefix(prefix) for bone in bones.values()))
    places = [_place(bone, bones) for bone in bones.values()]
    if joints is None:
        return None
    found = {joint: places[at] for joint, at in joints.items()}
    told = {joint: place for joint, place in found.items() if place is not None}
    if not {"pelvis", "l_hip", "r_hip"} <= set(told):
        return None
    position = axes.positions(np.array(list(told.values())))
    names = tuple(told)
    position -= position[names.index("pelvis")]
    left = position[names.index("l_hip")] - position[names.index("r_hip")]
    return Skeleton(names, position @ _turned_to_y(left))


def _place(bone: BodyDefinition, bones: dict[int, BodyDefinition]) -> FloatArray | None:
    """From the skeleton's root (3,), m, in the server's axes; None where its parents go round in a circle."""
    place, steps = np.array(bone.offset), 0
    while (parent := bones.get(bone.parent & 0xFFFF)) is not None and parent is not bone:
        bone, steps = parent, steps + 1
        place = place + bone.offset
        if steps > len(bones):
            return None
    return place


def _turned_to_y(left: FloatArray) -> FloatArray:
    """The matrix (3, 3), for rows, that turns a direction about the vertical until it lies in y and z."""
    x, y = left[:2] / max(float(np.hypot(*left[:2])), 1e-9)
    return np.array([[y, x, 0.0], [-x, y, 0.0], [0.0, 0.0, 1.0]])
