"""A body as a tree of hinges in its zero pose: its mirror plane, and its soles."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from retarget.errors import InputError
from retarget.setup.shape_fit import DIRECTIONS, hull_of_balls, link_geometries
from retarget.types import FloatArray

BASE = 0
"""Number of the node that no joint moves: the base."""
MAX_JOINTS = 250
"""A profile holds no more servos."""


@dataclass(frozen=True, eq=False)
class Node:
    """A hinge and the links that it carries rigidly, or the base.

    joint: its name, empty for the base. link: name of the link that it moves. parent: number of a node, -1 for the
    base. axis, anchor (3,): direction and a point of its axis. links: numbers of bodies, the moved one first; its last
    one carries the next hinges too. centres (k, 3), radii (k,): balls whose hull is the geometry. All in the world of
    the zero pose, m.
    """

    joint: str
    link: str
    parent: int
    axis: FloatArray
    anchor: FloatArray
    links: tuple[int, ...]
    lower: float
    upper: float
    centres: FloatArray
    radii: FloatArray

    @property
    def points(self) -> FloatArray:
        """Points (k, 3) m that the node takes up: its geometry, or else the anchor of its axis."""
        return self.centres if len(self.centres) else self.anchor[None]

    @property
    def middle(self) -> FloatArray:
        """Middle (3,) m of the box around its points."""
        return np.asarray(0.5 * (self.points.min(axis=0) + self.points.max(axis=0)))

    def nearest(self, point: FloatArray) -> FloatArray:
        """The point (3,) m of the node's axis that is nearest to a point (3,) m."""
        return np.asarray(self.anchor + ((point - self.anchor) @ self.axis) * self.axis)

    def distance(self, point: FloatArray) -> float:
        """Distance of a point from its axis, m."""
        way = point - self.anchor
        return float(np.linalg.norm(way - (way @ self.axis) * self.axis))


@dataclass(frozen=True, eq=False)
class Tree:
    """Nodes, a parent before its children; the first is the base. size: diagonal (m) of the box around everything."""

    nodes: tuple[Node, ...]
    size: float

    def children(self, node: int) -> list[int]:
        """The nodes that hang on a node."""
        return [number for number, other in enumerate(self.nodes) if other.parent == node]

    def below(self, node: int) -> list[int]:
        """A node and all that it carries."""
        found = [node]
        for number in range(node + 1, len(self.nodes)):
            if self.nodes[number].parent in found:
                found.append(number)
        return found

    def way(self, node: int) -> list[int]:
        """The nodes from the base to a node, both included."""
        found = [node]
        while self.nodes[found[-1]].parent >= 0:
            found.append(self.nodes[found[-1]].parent)
        return found[::-1]

    def points(self, nodes: Sequence[int]) -> FloatArray:
        """Places of nodes, (k, 3) m."""
        return np.concatenate([self.nodes[node].points for node in nodes])


def read_tree(model: Any, *, source: str = "") -> Tree:
    """The tree of a compiled `mujoco.MjModel` in its zero pose; source names it in messages.

    Raises InputError: no joints that servos turn, or too many.
    """
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    hinges = [index for index in range(model.njnt) if model.jnt_type[index] == mujoco.mjtJoint.mjJNT_HINGE]
    if not 1 <= len(hinges) <= MAX_JOINTS:
        raise InputError(
            "no robot of servos",
            where=source,
            found=f"{len(hinges)} hinges",
            allowed=f"1 to {MAX_JOINTS}",
            next_step="Give the body of a whole robot, whose moving joints are revolute or continuous (MJCF: hinge)",
        )
    numbers = {int(model.jnt_dofadr[joint]): number for number, joint in enumerate(hinges, 1)}
    parents = [numbers.get(int(model.dof_parentid[dof]), BASE) for dof in numbers]
    carried: list[list[int]] = [[] for _ in range(len(hinges) + 1)]
    for body in range(1, model.nbody):
        moved = model.body_weldid[body]  # the link above that a joint moves
        last_dof = int(model.body_dofadr[moved] + model.body_dofnum[moved] - 1)
        carried[numbers.get(last_dof, BASE)].append(body)
    balls = _balls(model, data)
    found = [_node(model, data, -1, -1, carried[BASE], balls)]
    for joint, parent, links in zip(hinges, parents, carried[1:], strict=True):
        found.append(_node(model, data, joint, parent, links, balls))
    around = np.concatenate([node.points for node in found])
    return Tree(tuple(found), float(np.linalg.norm(np.ptp(around, axis=0))))


def _balls(model: Any, data: Any) -> dict[int, tuple[FloatArray, FloatArray]]:
    """Centres (k, 3) in the world and radii (k,) of each body with geometry."""
    try:
        geometries, _ = link_geometries(model)
    except InputError:  # no geometry at all
        return {}
    return {
        geometry.link: (
            geometry.centres @ data.xmat[geometry.link].reshape(3, 3).T + data.xpos[geometry.link],
            geometry.radii,
        )
        for geometry in geometries
    }


def _node(
    model: Any, data: Any, joint: int, parent: int, links: list[int], balls: dict[int, tuple[FloatArray, FloatArray]]
) -> Node:
    parts = [balls[link] for link in links if link in balls]
    centres = np.concatenate([np.zeros((0, 3)), *(part[0] for part in parts)])
    radii = np.concatenate([np.zeros(0), *(part[1] for part in parts)])
    if joint < 0:
        origin = data.xpos[links[0]].copy() if links else np.zeros(3)
        return Node("", "", parent, np.array([0.0, 0.0, 1.0]), origin, tuple(links), -np.inf, np.inf, centres, radii)
    lower, upper = model.jnt_range[joint].tolist() if model.jnt_limited[joint] else (-np.inf, np.inf)
    body = int(model.jnt_bodyid[joint])
    name, link = model.joint(joint).name, model.body(body).name
    axis, anchor = data.xaxis[joint].copy(), data.xanchor[joint].copy()
    carried = tuple(links) or (body,)
    return Node(name, link, parent, axis, anchor, carried, lower, upper, centres, radii)


# Left and right: the plane that mirrors a robot onto itself, and which joint is whose mirror image.
#
# Lines of axes and the places of what they carry are compared, so names and link frames do not matter. Names count only
# for what has no mirror image: left and right of the same name, and a neck or head, which is in the middle.

TOLERANCE = 0.03
"""Share of the robot's size: so far a mirrored part may be from its counterpart."""
SIDES = {"l": 1, "left": 1, "r": -1, "right": -1}
"""Words of names: 1 for the left, -1 for the right."""
MIDDLE = {"neck", "head"}
PARALLEL = 0.97
"""Least cosine between a mirrored axis and its counterpart."""
NORMALS = (np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]))
"""A robot looks along x (REP-103), or along y."""


@dataclass(frozen=True, eq=False)
class Mirror:
    """The plane normal @ point = offset (m), and `partner[node]`: the node's mirror image, itself in the middle.

    What has none is in neither. sign[node]: 1 or -1; mirrored postures have the angle times it at the partner.
    by_name[node]: how far (m) a node is from being the image of its partner, where only names say that it is one.
    """

    normal: FloatArray
    offset: float
    partner: dict[int, int]
    sign: dict[int, float]
    by_name: dict[int, float]

    def pairs(self, tree: Tree) -> list[tuple[int, int]]:
        """Limbs: first nodes of mirrored branches that hang on the same node of the middle; the one with the larger
        coordinate along the normal first."""
        found = []
        for node, other in self.partner.items():
            parent = tree.nodes[node].parent
            if node < other and parent == tree.nodes[other].parent and self.partner.get(parent) == parent:
                ahead = (_mark(tree, node) - _mark(tree, other)) @ self.normal > 0.0
                found.append((node, other) if ahead else (other, node))
        return found


def find_mirror(tree: Tree) -> Mirror | None:
    """The plane with the most mirrored joints; None where there are no two limbs that mirror each other."""
    planes = [_matched(tree, normal, offset) for normal in NORMALS for offset in _offsets(tree, normal)]
    return max((plane for plane in planes if plane.pairs(tree)), key=_evidence, default=None)


def _evidence(mirror: Mirror) -> tuple[int, int, float]:
    """Joints that are mirrored, joints of which names say so, and how near (m) the latter come to it."""
    return len(mirror.partner) - len(mirror.by_name), len(mirror.by_name), -sum(mirror.by_name.values())


def _offsets(tree: Tree, normal: FloatArray) -> list[float]:
    """Where the plane may be: through the base's origin, or mid-way between two branches of the base."""
    marks = [float(_mark(tree, child) @ normal) for child in tree.children(BASE)]
    return [float(tree.nodes[BASE].anchor @ normal), *(0.5 * sum(pair) for pair in combinations(marks, 2))]


def _matched(tree: Tree, normal: FloatArray, offset: float) -> Mirror:
    mirror = Mirror(normal, offset, {BASE: BASE}, {BASE: 1.0}, {})
    waiting = [(BASE, BASE)]
    while waiting:
        node, other = waiting.pop()
        candidates = []
        for mine in tree.children(node):
            for their in tree.children(other):
                apart, parallel = _apart(tree, mirror, mine, their)
                mirrored = parallel and apart <= TOLERANCE * tree.size
                if mirrored or _counterparts(tree.nodes[mine], tree.nodes[their], same=mine == their):
                    candidates.append((not mirrored, apart, mine, their))
        for only_named, apart, mine, their in sorted(candidates):
            if mine in mirror.partner or their in mirror.partner:
                continue
            sign = _sign(tree, normal, mine, their)
            mirror.partner.update({mine: their, their: mine})
            mirror.sign.update({mine: sign, their: sign})
            if only_named:
                mirror.by_name.update({mine: apart, their: apart})
            waiting.append((mine, their))
    return mirror


def _apart(tree: Tree, mirror: Mirror, node: int, other: int) -> tuple[float, bool]:
    """How far (m) a node's mirror image is from another node, axis and geometry; whether their axes are parallel."""
    mine, theirs, normal = tree.nodes[node], tree.nodes[other], mirror.normal
    axis = mine.axis - 2.0 * (mine.axis @ normal) * normal
    line = theirs.distance(_image(mine.anchor, mirror))
    mark = float(np.linalg.norm(_image(_mark(tree, node), mirror) - _mark(tree, other)))
    return max(line, mark), bool(abs(axis @ theirs.axis) >= PARALLEL)


def _counterparts(node: Node, other: Node, *, same: bool) -> bool:
    """Whether names say that two nodes are left and right of each other, or that one node is the neck or the head."""
    side, words = side_of(node)
    if same:
        return side == 0 and not MIDDLE.isdisjoint(words)
    other_side, other_words = side_of(other)
    return side * other_side == -1 and words == other_words


def side_of(node: Node) -> tuple[int, list[str]]:
    """1 for a joint or link of the left by its name, -1 of the right, 0 of neither; the other words of that name, which
    are parted by signs or by capitals."""
    for name in (node.joint, node.link):
        words = [word.lower() for word in re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|[0-9]+", name)]
        side = next((SIDES[word] for word in words if word in SIDES), 0)
        if side or not MIDDLE.isdisjoint(words):
            return side, [word for word in words if word not in SIDES]
    return 0, []


def _image(point: FloatArray, mirror: Mirror) -> FloatArray:
    return np.asarray(point - 2.0 * (point @ mirror.normal - mirror.offset) * mirror.normal)


def _mark(tree: Tree, node: int) -> FloatArray:
    """Where a branch is: the mean of the middles of its parts."""
    return np.asarray(np.mean([tree.nodes[n].middle for n in tree.below(node)], axis=0))


def _sign(tree: Tree, normal: FloatArray, node: int, other: int) -> float:
    """A turn is a pseudovector: its mirror image is minus that of its axis."""
    axis = tree.nodes[node].axis
    return 1.0 if (2.0 * (axis @ normal) * normal - axis) @ tree.nodes[other].axis > 0.0 else -1.0


# The sole: the flat underside that a foot stands on, as the hull of the balls that its geometry is made of.

STEEPEST = np.cos(np.radians(50.0))
"""A foot is turned no further from flat than this in the zero pose."""
ALIKE = np.cos(np.radians(8.0))
"""Cosine of the largest angle between the normals of the faces of one underside."""
TOUCHING_M = 0.0015
"""Largest height above the ground of a point that touches it."""
MAX_CORNERS = 16
"""Corners of the outline in a profile at most."""
MIN_AREA = 1e-4
"""[m^2] A smaller underside is a point or an edge, on which the robot cannot stand."""


@dataclass(frozen=True, eq=False)
class Sole:
    """up (3,): the normal of the sole, into the foot. points (k, 3) m: that touch the ground, in the world of the zero
    pose."""

    up: FloatArray
    points: FloatArray


def flat_underside(tree: Tree, nodes: Sequence[int]) -> Sole | None:
    """The largest flat underside of these nodes together; None where they have no geometry that could stand."""
    centres = np.concatenate([tree.nodes[node].centres for node in nodes])
    radii = np.concatenate([tree.nodes[node].radii for node in nodes])
    down = _facing_down(centres, radii) if len(centres) else None
    if down is None:
        return None
    lowest = centres + radii[:, None] * down
    depth = lowest @ down
    touching = lowest[depth >= depth.max() - TOUCHING_M]
    around = touching - touching.mean(axis=0)
    sides = np.ptp(around @ np.linalg.svd(around)[2][:2].T, axis=0)
    return None if sides.prod() < MIN_AREA else Sole(-down, touching)


def outline(points: FloatArray) -> FloatArray:
    """Corners (k, 2) of the convex outline of points (n, 2), counter-clockwise from the front left: those that are
    farthest in MAX_CORNERS directions."""
    angles = np.pi / 4.0 + np.arange(MAX_CORNERS) * (2.0 * np.pi / MAX_CORNERS)
    farthest = np.argmax(points @ np.stack([np.cos(angles), np.sin(angles)]), axis=0)
    return np.asarray(points[list(dict.fromkeys(farthest.tolist()))])


def _facing_down(centres: FloatArray, radii: FloatArray) -> FloatArray | None:
    """Outward normal (3,) of the largest part of the hull that looks down in the zero pose."""
    hull = hull_of_balls(centres, radii, DIRECTIONS[::8])
    if hull is None:
        return np.array([0.0, 0.0, -1.0])
    normals = hull.equations[:, :3]
    corners = hull.points[hull.simplices]
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    looking = np.flatnonzero(normals[:, 2] <= -STEEPEST)
    if not len(looking):
        return None
    alike = normals[looking] @ normals[looking].T > ALIKE
    sums = alike @ areas[looking]
    best = looking[alike[int(np.argmax(sums))]]
    normal = (normals[best] * areas[best][:, None]).sum(axis=0)
    return np.asarray(normal / np.linalg.norm(normal))
