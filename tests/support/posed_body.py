"""The body file of a profile in MuJoCo, posed: where frames of the profile are, the centre of mass, what touches."""

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from retarget.schema.profile import RobotProfile

Array = NDArray[np.float64]
Posture = Mapping[str, float]


class PosedBody:
    """A body in a posture; its root stays where the body file has it."""

    def __init__(self, profile: RobotProfile) -> None:
        self.profile = profile
        self.model: Any = mujoco.MjModel.from_xml_path(str(profile.body_path))
        self.data: Any = mujoco.MjData(self.model)

    def pose(self, joints: Posture) -> "PosedBody":
        self.data.qpos[:] = self.model.qpos0
        for joint, angle in joints.items():
            self.data.qpos[self.model.joint(joint).qposadr[0]] = angle
        mujoco.mj_forward(self.model, self.data)
        return self

    def frame(self, name: str) -> tuple[Array, Array]:
        """World position (3,) and rotation (3, 3) of a frame of the profile."""
        frame = self.profile.frames[name]
        link = self.data.body(frame.link)
        rotation = np.array(link.xmat).reshape(3, 3)
        own = np.zeros(9)
        mujoco.mju_quat2Mat(own, np.array(frame.quat))
        return np.array(link.xpos) + rotation @ np.array(frame.pos), rotation @ own.reshape(3, 3)

    def at(self, name: str) -> Array:
        return self.frame(name)[0]

    def anchor(self, joint: str) -> tuple[Array, Array]:
        """Anchor (3,) of a joint and its axis (3,), seen from the base's origin."""
        found = self.data.joint(joint)
        return np.array(found.xanchor) - self.data.qpos[:3], np.array(found.xaxis)

    def com_in_stand_frame(self) -> Array:
        """Centre of mass (3,) from the middle of the soles, which are made level."""
        (left, left_axes), (right, right_axes) = self.frame("l_sole"), self.frame("r_sole")
        up = left_axes[:, 2] + right_axes[:, 2]
        up /= np.linalg.norm(up)
        ahead = left_axes[:, 0] + right_axes[:, 0]
        ahead -= up * (up @ ahead)
        ahead /= np.linalg.norm(ahead)
        axes = np.stack([ahead, np.cross(up, ahead), up])
        return np.asarray(axes @ (self.data.subtree_com[1] - (left + right) / 2))

    def sole_corners(self) -> Array:
        """Corners (c, 3) of all soles."""
        corners = []
        for foot in self.profile.feet.values():
            position, axes = self.frame(foot.frame)
            corners += [position + axes @ (x, y, 0.0) for x, y in foot.polygon]
        return np.array(corners)

    def support_margin(self) -> float:
        """How far the centre of mass is inside the hull of the soles' corners, m."""
        equations = ConvexHull(self.sole_corners()[:, :2]).equations  # outward normal, offset
        return -float(np.max(equations[:, :2] @ self.data.subtree_com[1][:2] + equations[:, 2]))

    def touching(self) -> set[tuple[str, str]]:
        """Pairs of links in contact."""
        links = self.model.geom_bodyid
        return {(self.model.body(links[c.geom1]).name, self.model.body(links[c.geom2]).name) for c in self.data.contact}
