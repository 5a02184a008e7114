"""The frames of a profile: where hips, knees, ankles, soles, shoulders, elbows, hands, neck and head of a body are."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from retarget.rotations import from_matrix
from retarget.schema.profile_parts import Foot, Frame
from retarget.setup.limbs import Anatomy, Limb, arm_roles, crossing, leg_roles, pitch_joints, tip
from retarget.setup.tree import Tree, flat_underside, outline
from retarget.types import FloatArray

SIDES = {"l": "left", "r": "right"}
"""Sides as they begin names of frames, and in `feet`."""


@dataclass(frozen=True, eq=False)
class FoundFrame:
    """A frame on a node. position (3,) m and axes (3, 3), columns x, y, z, in the world of the zero pose. about: what
    it is, for a comment."""

    name: str
    node: int
    position: FloatArray
    axes: FloatArray
    about: str = ""


@dataclass(frozen=True, eq=False)
class Found:
    """All frames by name, the soles by side, and what could not be found."""

    frames: dict[str, FoundFrame]
    feet: dict[str, Foot]
    missing: tuple[str, ...]


def find_frames(tree: Tree, anatomy: Anatomy) -> Found:
    """Every frame that the body has a place for; both soles or none."""
    frames: list[FoundFrame] = []
    feet: dict[str, Foot] = {}
    missing: list[str] = []
    for side, leg in zip(SIDES, anatomy.legs, strict=False):
        found, foot = _leg(tree, anatomy, leg, side)
        frames += found
        if foot is None:
            missing.append(f"{side}_sole: the foot has no flat underside")
        else:
            feet[SIDES[side]] = foot
    sides = tuple(SIDES) if len(anatomy.arms) == 2 else ("r",)
    for side, arm in zip(sides, anatomy.arms, strict=False):
        frames += _arm(tree, anatomy, arm, side)
    frames = [*_trunk(tree, anatomy, frames), *frames]
    if not anatomy.head:
        missing.append("head: nothing turns above the trunk, so the frame is at its top")
    if not anatomy.legs:
        missing.append("legs: no two limbs reach the ground, so the root is fixed")
    missing += [f"{side}_hand: no such arm" for side in SIDES if side not in sides[: len(anatomy.arms)]]
    return Found({frame.name: frame for frame in frames}, feet if len(feet) == 2 else {}, tuple(missing))


def _leg(tree: Tree, anatomy: Anatomy, leg: Limb, side: str) -> tuple[list[FoundFrame], Foot | None]:
    axes = anatomy.axes
    roles = leg_roles(tree, leg, anatomy.left)
    pitches = pitch_joints(tree, leg, anatomy.left)
    others = [node for node in leg.nodes if node not in pitches]
    before = [node for node in others if node < roles.hip]
    crossed = before[-1:] or others[:1]
    hip = crossing(tree, roles.hip, crossed[0]) if crossed else tree.nodes[roles.hip].anchor
    frames = [FoundFrame(f"{side}_hip", leg.parent, hip, axes, "where the axes of the hip meet")]

    def in_plane(node: int) -> FloatArray:
        """The point of an axis across the robot that is in the middle plane of the leg."""
        axis, anchor = tree.nodes[node].axis, tree.nodes[node].anchor
        return np.asarray(anchor + ((hip - anchor) @ anatomy.left) / (axis @ anatomy.left) * axis)

    if roles.knee is not None:
        frames.append(FoundFrame(f"{side}_knee", roles.knee, in_plane(roles.knee), axes))
    foot = leg.nodes[-1]
    rolls = [node for node in others if roles.ankle is not None and node > roles.ankle]
    ankle = roles.ankle if roles.ankle is not None else foot
    if rolls:
        place = crossing(tree, ankle, rolls[-1])
    else:
        place = in_plane(ankle) if roles.ankle is not None else tree.nodes[foot].anchor
    frames.append(FoundFrame(f"{side}_ankle", foot, place, axes))
    sole = flat_underside(tree, leg.ends)
    if sole is None:
        return frames, None
    x = anatomy.forward - (anatomy.forward @ sole.up) * sole.up
    x /= np.linalg.norm(x)
    turned = np.stack([x, np.cross(sole.up, x), sole.up], axis=1)
    flat = sole.points @ turned
    low, high = flat.min(axis=0), flat.max(axis=0)
    middle = 0.5 * (low + high)
    toe = np.array([high[0], middle[1], middle[2]])
    frames.append(FoundFrame(f"{side}_sole", foot, turned @ middle, turned, "middle of the sole: x to the toes, z up"))
    frames.append(FoundFrame(f"{side}_toe", foot, turned @ toe, turned))
    polygon = outline((flat[:, :2] - middle[:2]).round(4)).tolist()
    return frames, Foot.model_validate({"frame": f"{side}_sole", "polygon": polygon})


def _arm(tree: Tree, anatomy: Anatomy, arm: Limb, side: str) -> list[FoundFrame]:
    roles, axes = arm_roles(tree, arm), anatomy.axes
    first = arm.nodes[0]
    others = [node for node in arm.nodes[1:] if abs(tree.nodes[node].axis @ tree.nodes[first].axis) < 0.9]
    shoulder = crossing(tree, first, others[0]) if others else tree.nodes[first].anchor
    frames = [FoundFrame(f"{side}_shoulder", arm.parent, shoulder, axes, "on the trunk: the arm does not move it")]
    start = shoulder
    if roles.elbow is not None:
        start = tree.nodes[roles.elbow].nearest(tree.nodes[roles.elbow].middle)
        frames.append(FoundFrame(f"{side}_elbow", roles.elbow, start, axes))
    if roles.wrist is not None:
        node = arm.nodes[arm.nodes.index(roles.wrist) - 1]
        place = tree.nodes[roles.wrist].nearest(start)
        frames.append(FoundFrame(f"{side}_hand", node, place, axes, "the wrist: the end of the forearm"))
    else:
        frames.append(FoundFrame(f"{side}_hand", arm.nodes[-1], tip(tree, arm, start), axes, "the tip of the forearm"))
    return frames


def _trunk(tree: Tree, anatomy: Anatomy, limbs: list[FoundFrame]) -> list[FoundFrame]:
    """Pelvis, neck and head, of which neck and head are always made: a follower needs them."""
    places, axes = {frame.name: frame.position for frame in limbs}, anatomy.axes
    frames = []
    if "l_hip" in places and "r_hip" in places:
        hips = 0.5 * (places["l_hip"] + places["r_hip"])
        frames.append(FoundFrame("pelvis", anatomy.pelvis, hips, axes, "mid-way between the hips"))
    chest, centre = anatomy.chest, tree.nodes[anatomy.chest].middle
    if anatomy.head:
        first, last = anatomy.head[0], anatomy.head[-1]
        head = FoundFrame("head", last, tree.nodes[last].middle, axes, "centre of the head, x to where it looks")
        return [*frames, FoundFrame("neck", chest, tree.nodes[first].anchor, axes), head]
    top = np.array([centre[0], centre[1], tree.nodes[chest].points[:, 2].max()])
    neck = FoundFrame("neck", chest, centre, axes, "middle of the trunk: there is no neck")
    return [*frames, neck, FoundFrame("head", chest, top, axes, "top of the trunk: there is no head")]


# A drafted robot in a posture: where its frames and its centre of mass are.

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

    def entries(self) -> dict[str, tuple[Frame, str]]:
        """The frames for a profile, each with what it is."""
        found = {}
        for name, (link, position, axes) in self._local.items():
            quat = from_matrix(axes).round(6) + 0.0  # no -0
            turn = {} if abs(quat[0]) == 1.0 else {"quat": quat.tolist()}
            place = {"link": self._model.body(link).name, "pos": (position.round(5) + 0.0).tolist()}
            entry = Frame.model_validate(place | turn)
            found[name] = entry, self.found.frames[name].about
        return found

    def inside(self, joint: str, angle: float) -> float:
        """The angle, drawn into the joint's limits."""
        low, high = self.limits[joint]
        return min(max(angle, low), high)

    def mirrored(self, angles: Angles) -> dict[str, float]:
        """Add to angles, rad, those of the mirrored joints."""
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
        """Place everything with these angles, rad."""
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
