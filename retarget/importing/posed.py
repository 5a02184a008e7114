"""A drafted robot in a posture: where its frames and its centre of mass are."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from retarget.importing.frames_found import Found
from retarget.importing.limbs import Anatomy
from retarget.importing.tree import Tree
from retarget.rotations import FloatArray

__all__ = ["Angles", "Placed", "Posed"]

Angles = Mapping[str, float]
"""Joint -> rad; joints that are not named are as near to 0 as their limits let them."""


@dataclass(frozen=True, eq=False)
class Placed:
    """What a posture does: positions (3,) m and axes (3, 3) of frames by name, centre_of_mass (3,) m."""

    positions: dict[str, FloatArray]
    axes: dict[str, FloatArray]
    centre_of_mass: FloatArray


class Posed:
    """Forward kinematics of one body, by joint names; the base stays where the file has it."""

    def __init__(
        self, model: Any, tree: Tree, anatomy: Anatomy, found: Found, limits: Mapping[str, tuple[float, float]]
    ) -> None:
        """limits: of every joint, rad."""
        import mujoco

        self.tree, self.anatomy, self.found, self.limits = tree, anatomy, found, dict(limits)
        self._engine, self._model, self._data = mujoco, model, mujoco.MjData(model)
        self._address = {node.joint: int(model.joint(node.joint).qposadr[0]) for node in tree.nodes[1:]}
        mujoco.mj_kinematics(model, self._data)
        self._local = {}
        for name, frame in found.frames.items():
            link = tree.nodes[frame.node].links[0]
            turn = self._data.xmat[link].reshape(3, 3)
            self._local[name] = (link, turn.T @ (frame.position - self._data.xpos[link]), turn.T @ frame.axes)

    def on_link(self, name: str) -> tuple[int, FloatArray, FloatArray]:
        """A frame's link, and its position (3,) m and axes (3, 3) there."""
        return self._local[name]

    def inside(self, joint: str, angle: float) -> float:
        """The angle, drawn into the joint's limits."""
        low, high = self.limits[joint]
        return min(max(angle, low), high)

    def mirrored(self, angles: Angles) -> dict[str, float]:
        """The angles and those of the mirrored joints."""
        mirror, nodes = self.anatomy.mirror, self.tree.nodes
        both = dict(angles)
        if mirror is None:
            return both
        number = {node.joint: place for place, node in enumerate(nodes)}
        for joint, angle in angles.items():
            node = number[joint]
            if node in mirror.partner and mirror.partner[node] != node:
                other = nodes[mirror.partner[node]].joint
                both[other] = self.inside(other, mirror.sign[node] * angle)
        return both

    def place(self, angles: Angles) -> Placed:
        """Where everything is with these angles."""
        self._data.qpos[:] = self._model.qpos0
        for joint, address in self._address.items():
            self._data.qpos[address] = angles[joint] if joint in angles else self.inside(joint, 0.0)
        self._engine.mj_kinematics(self._model, self._data)
        self._engine.mj_comPos(self._model, self._data)
        positions, axes = {}, {}
        for name, (link, point, turn) in self._local.items():
            matrix = self._data.xmat[link].reshape(3, 3)
            positions[name] = self._data.xpos[link] + matrix @ point
            axes[name] = matrix @ turn
        return Placed(positions, axes, np.array(self._data.subtree_com[0]))
