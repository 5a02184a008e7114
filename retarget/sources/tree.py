"""A skeleton as a tree of joints, and its forward kinematics over all frames at once.

The common form of ASF and BVH: a joint turns everything below it, and its offset is constant in its parent's frame.
Axes and units are those of the file.
"""

from dataclasses import dataclass

import numpy as np

from retarget import rotations
from retarget.rotations import FloatArray

__all__ = ["JointTree", "Pose", "forward_kinematics"]


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
        """Joint centres (n, 3) with all rotations zero and the root at the origin."""
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
