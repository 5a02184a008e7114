"""The frames of a profile (hips, knees, soles, shoulders, hands, head ...), measured on a body with known links."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from retarget.rotations import from_matrix
from retarget.schema.profile_parts import Foot, ProfileFrame
from retarget.setup.links import ACROSS, NORMALS, PartLinks, pitch_joints
from retarget.setup.tree import BASE, UP, Tree, flat_underside, outline
from retarget.types import FloatArray

SIDES = {"l": "left", "r": "right"}
"""Prefixes of frames -> keys of `feet`."""


@dataclass(frozen=True)
class LimbNodes:
    """A limb. nodes: of its hinges, from the trunk outwards. parent: the node that carries it. ends: its last node with
    all descendants, the foot, or the hand with its fingers. bend: the node of its knee or elbow."""

    nodes: tuple[int, ...]
    parent: int
    ends: tuple[int, ...]
    bend: int | None


@dataclass(frozen=True, eq=False)
class Anatomy:
    """The parts of a robot. forward, left (3,): its axes in the zero pose, z up. legs, arms: by side, l or r. pelvis,
    chest: nodes that carry them. head: node, None without a head."""

    forward: FloatArray
    left: FloatArray
    legs: dict[str, LimbNodes]
    arms: dict[str, LimbNodes]
    pelvis: int
    chest: int
    head: int | None

    @property
    def axes(self) -> FloatArray:
        """Unit vectors forward, left and up as columns (3, 3)."""
        return np.stack([self.forward, self.left, UP], axis=1)


def find_anatomy(tree: Tree, links: PartLinks) -> Anatomy:
    """Find the joints of each part of a robot. A limb begins where its path from the base leaves that of the others."""
    node = {part: tree.links[link] for part, link in links.model_dump().items() if link is not None}
    limbs: dict[str, dict[str, LimbNodes]] = {"sole": {}, "hand": {}}
    trunk = {number for part in ("pelvis", "chest", "head") if part in node for number in tree.path(node[part])}
    for end, bend in (("sole", "knee"), ("hand", "elbow")):
        for side, other in ("lr", "rl"):
            if f"{side}_{end}" in node:
                shared = trunk | set(tree.path(node.get(f"{other}_{end}", BASE)))
                path = tree.path(node[f"{side}_{end}"])
                nodes = tuple(number for number in path if number not in shared) or path[-1:]
                ends, middle = tuple(tree.below(nodes[-1])), node.get(f"{side}_{bend}")
                limbs[end][side] = LimbNodes(tuple(nodes), tree.nodes[nodes[0]].parent, ends, middle)
    left = np.array([0.0, 1.0, 0.0])
    pairs = [pair for pair in limbs.values() if len(pair) == 2]
    if pairs:
        middles = [[tree.points([*pair[side].nodes]).mean(axis=0) for side in "lr"] for pair in pairs]
        across = np.sum([one - other for one, other in middles], axis=0)
        left = max((*NORMALS, -NORMALS[0], -NORMALS[1]), key=lambda normal: float(normal @ across))
    parents = [next((limb.parent for limb in limbs[end].values()), BASE) for end in ("sole", "hand")]
    pelvis, chest = node.get("pelvis", parents[0]), node.get("chest", parents[1])
    return Anatomy(np.cross(left, UP), left, limbs["sole"], limbs["hand"], pelvis, chest, node.get("head"))


@dataclass(frozen=True, eq=False)
class FoundFrame:
    """A frame on a node. position (3,), m, and axes (3, 3), columns x, y, z, in the world of the zero pose. about:
    comment for the profile."""

    name: str
    node: int
    position: FloatArray
    axes: FloatArray
    about: str = ""


@dataclass(frozen=True, eq=False)
class FoundFrames:
    """Frames by name, soles by side, and sentences on missing parts."""

    frames: dict[str, FoundFrame]
    feet: dict[str, Foot]
    missing: tuple[str, ...]


def find_frames(tree: Tree, anatomy: Anatomy) -> FoundFrames:
    """Find all frames, with both soles or none."""
    frames: list[FoundFrame] = []
    feet: dict[str, Foot] = {}
    missing: list[str] = []
    for side, leg in anatomy.legs.items():
        found, foot = _leg(tree, anatomy, leg, side)
        frames += found
        if foot is None:
            missing.append(f"{side}_sole: the foot has no flat underside")
        else:
            feet[SIDES[side]] = foot
    for side, arm in anatomy.arms.items():
        frames += _arm(tree, anatomy, arm, side)
    frames = [*_trunk(tree, anatomy, frames), *frames]
    if anatomy.head is None:
        missing.append("head: nothing turns above the trunk, so the frame is at its top")
    if not anatomy.legs:
        missing.append("legs: none, so the root is fixed")
    missing += [f"{side}_hand: no such arm" for side in SIDES if side not in anatomy.arms]
    return FoundFrames({frame.name: frame for frame in frames}, feet if len(feet) == 2 else {}, tuple(missing))


def _leg(tree: Tree, anatomy: Anatomy, leg: LimbNodes, side: str) -> tuple[list[FoundFrame], Foot | None]:
    axes, foot = anatomy.axes, leg.nodes[-1]
    pitches = pitch_joints(tree, leg.nodes, anatomy.left)
    others = [node for node in leg.nodes if node not in pitches]
    first = next((node for node in pitches if leg.bend is None or node < leg.bend), leg.nodes[0])
    crossed = [node for node in others if node < first][-1:] or [node for node in others if node != first][:1]
    hip = crossing(tree, first, crossed[0]) if crossed else tree.nodes[first].anchor
    frames = [FoundFrame(f"{side}_hip", leg.parent, hip, axes, "where the axes of the hip meet")]

    def in_plane(node: int) -> FloatArray:
        """The point of an axis in the middle plane of the leg."""
        axis, anchor = tree.nodes[node].axis, tree.nodes[node].anchor
        across = float(axis @ anatomy.left)
        return np.asarray(anchor + ((hip - anchor) @ anatomy.left) / across * axis if abs(across) > ACROSS else anchor)

    if leg.bend is not None:
        frames.append(FoundFrame(f"{side}_knee", leg.bend, in_plane(leg.bend), axes))
    below = [node for node in pitches if leg.bend is not None and node > leg.bend]
    ankle = below[-1] if below else foot
    rolls = [node for node in others if below and node > ankle]
    place = crossing(tree, ankle, rolls[-1]) if rolls else in_plane(ankle)
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


def wrist_of(tree: Tree, arm: LimbNodes) -> int | None:
    """The first joint behind the elbow that does not turn about the forearm, None if there is none."""
    if arm.bend is None:
        return None
    forearm = tree.points(arm.ends).mean(axis=0) - tree.nodes[arm.bend].anchor
    forearm = forearm / max(float(np.linalg.norm(forearm)), 1e-9)
    behind = arm.nodes[arm.nodes.index(arm.bend) + 1 :] if arm.bend in arm.nodes else ()
    return next((node for node in behind if abs(tree.nodes[node].axis @ forearm) < ACROSS), None)


def _arm(tree: Tree, anatomy: Anatomy, arm: LimbNodes, side: str) -> list[FoundFrame]:
    wrist, axes = wrist_of(tree, arm), anatomy.axes
    first = arm.nodes[0]
    others = [node for node in arm.nodes[1:] if abs(tree.nodes[node].axis @ tree.nodes[first].axis) < 0.9]
    shoulder = crossing(tree, first, others[0]) if others else tree.nodes[first].anchor
    frames = [FoundFrame(f"{side}_shoulder", arm.parent, shoulder, axes, "on the trunk: the arm does not move it")]
    start = shoulder
    if arm.bend is not None:
        start = tree.nodes[arm.bend].nearest(tree.nodes[arm.bend].middle)
        frames.append(FoundFrame(f"{side}_elbow", arm.bend, start, axes))
    if wrist is not None:
        node = arm.nodes[arm.nodes.index(wrist) - 1]
        place = tree.nodes[wrist].nearest(start)
        frames.append(FoundFrame(f"{side}_hand", node, place, axes, "the wrist: the end of the forearm"))
    else:
        frames.append(FoundFrame(f"{side}_hand", arm.nodes[-1], tip(tree, arm, start), axes, "the tip of the forearm"))
    return frames


def _trunk(tree: Tree, anatomy: Anatomy, limbs: list[FoundFrame]) -> list[FoundFrame]:
    """Find pelvis, neck and head. Neck and head always exist, since a follower needs them."""
    places, axes = {frame.name: frame.position for frame in limbs}, anatomy.axes
    frames = []
    if "l_hip" in places and "r_hip" in places:
        hips = 0.5 * (places["l_hip"] + places["r_hip"])
        frames.append(FoundFrame("pelvis", anatomy.pelvis, hips, axes, "mid-way between the hips"))
    chest, last = anatomy.chest, anatomy.head
    centre = tree.nodes[chest].middle
    if last is not None:
        trunk = {*tree.path(chest), *tree.path(anatomy.pelvis)}
        first = next((node for node in tree.path(last) if node not in trunk), last)
        head = FoundFrame("head", last, tree.nodes[last].middle, axes, "centre of the head, x to where it looks")
        return [*frames, FoundFrame("neck", chest, tree.nodes[first].anchor, axes), head]
    top = np.array([centre[0], centre[1], tree.nodes[chest].points[:, 2].max()])
    neck = FoundFrame("neck", chest, centre, axes, "middle of the trunk: there is no neck")
    return [*frames, neck, FoundFrame("head", chest, top, axes, "top of the trunk: there is no head")]


def tip(tree: Tree, arm: LimbNodes, start: FloatArray) -> FloatArray:
    """Middle (3,), m, of the far end of a hand, seen from `start` (3,)."""
    points = tree.points(arm.ends)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    direction = middle - start
    length = float(np.linalg.norm(direction))
    if length < 1e-6:
        return np.asarray(middle)
    direction = direction / length
    return np.asarray(start + float(((points - start) @ direction).max()) * direction)


def crossing(tree: Tree, node: int, other: int) -> FloatArray:
    """Point (3,) of the axis of `node` that is nearest to the axis of `other`, or to its anchor if they are
    parallel."""
    a, b = tree.nodes[node], tree.nodes[other]
    offset, cosine = b.anchor - a.anchor, float(a.axis @ b.axis)
    if 1.0 - cosine * cosine < 1e-3:
        along = float(offset @ a.axis)
    else:
        along = float((offset @ a.axis - cosine * (offset @ b.axis)) / (1.0 - cosine * cosine))
    return np.asarray(a.anchor + along * a.axis)


# Kinematics of a drafted robot.

Angles = Mapping[str, float]
"""Joint -> rad. Other joints are as near to 0 as their limits allow."""


@dataclass(frozen=True, eq=False)
class Placed:
    """A posture in the world: positions (3,), m, and axes (3, 3) of frames by name, centre_of_mass (3,), m."""

    positions: dict[str, FloatArray]
    axes: dict[str, FloatArray]
    centre_of_mass: FloatArray


class Posed:
    """Forward kinematics of one body by joint names. The base stays as in the file."""

    def __init__(
        self, model: Any, tree: Tree, anatomy: Anatomy, found: FoundFrames, limits: Mapping[str, tuple[float, float]]
    ) -> None:
        """limits: of every joint, rad."""
        import mujoco

        self.tree, self.anatomy, self.found, self.limits = tree, anatomy, found, dict(limits)
        self._engine, self._model, self._data = mujoco, model, mujoco.MjData(model)
        self._address = {node.joint: int(model.joint(node.joint).qposadr[0]) for node in tree.nodes[1:]}
        mujoco.mj_kinematics(model, self._data)
        self._local = {}
        for name, frame in found.frames.items():
            names = tree.nodes[frame.node].names
            link = int(model.body(names[0]).id) if names else 0
            turn = self._data.xmat[link].reshape(3, 3)
            self._local[name] = (link, turn.T @ (frame.position - self._data.xpos[link]), turn.T @ frame.axes)

    def entries(self) -> dict[str, tuple[ProfileFrame, str]]:
        """Frames for a profile, each with its comment."""
        found = {}
        for name, (link, position, axes) in self._local.items():
            quat = from_matrix(axes).round(6) + 0.0  # no -0
            turn = {} if abs(quat[0]) == 1.0 else {"quat": quat.tolist()}
            place = {"link": self._model.body(link).name, "pos": (position.round(5) + 0.0).tolist()}
            entry = ProfileFrame.model_validate(place | turn)
            found[name] = entry, self.found.frames[name].about
        return found

    def inside(self, joint: str, angle: float) -> float:
        """Clamp an angle, rad, to the joint's limits."""
        low, high = self.limits[joint]
        return min(max(angle, low), high)

    def place(self, angles: Angles) -> Placed:
        """Compute frames and centre of mass of a posture."""
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
