"""A body as a tree of hinges in its zero pose, and the soles of its feet."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from retarget.errors import InputError
from retarget.setup.shape_fit import DIRECTIONS, hull_of_balls, link_geometries, principal_axes
from retarget.types import FloatArray

BASE = 0
"""Index of the base, the node that no joint moves."""
MAX_JOINTS = 250
"""Most servos of a profile."""
UP = np.array([0.0, 0.0, 1.0])
"""Up, in the world."""
_WORDS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|[0-9]+")


def words_of(name: str) -> list[str]:
    """Split a name at signs and capitals into words in lower case."""
    return [word.lower() for word in _WORDS.findall(name)]


@dataclass(frozen=True, eq=False)
class HingeNode:
    """A hinge and the links that it carries rigidly, or the base, in the world of the zero pose, m.

    joint: "" for the base. names: of the links, the moved one first. parent: -1 for the base. axis, anchor (3,):
    direction and a point of its axis. lower, upper: rad. centres (k, 3), radii (k,): see `LinkGeometry`.
    """

    joint: str
    names: tuple[str, ...]
    parent: int
    axis: FloatArray
    anchor: FloatArray
    lower: float
    upper: float
    centres: FloatArray
    radii: FloatArray

    @property
    def points(self) -> FloatArray:
        """Points (k, 3), m, of its geometry, or else the anchor of its axis."""
        return self.centres if len(self.centres) else self.anchor[None]

    @property
    def middle(self) -> FloatArray:
        """Middle (3,), m, of the box around its points."""
        return np.asarray(0.5 * (self.points.min(axis=0) + self.points.max(axis=0)))

    def nearest(self, point: FloatArray) -> FloatArray:
        """The point (3,), m, of its axis that is nearest to a point (3,)."""
        return np.asarray(self.anchor + ((point - self.anchor) @ self.axis) * self.axis)

    def distance(self, point: FloatArray) -> float:
        """Distance of a point from its axis, m."""
        return float(np.linalg.norm(point - self.nearest(point)))


@dataclass(frozen=True, eq=False)
class Tree:
    """Nodes, parents before children, the base first. size: diagonal of the box around all points, m."""

    nodes: tuple[HingeNode, ...]
    size: float

    @property
    def links(self) -> dict[str, int]:
        """The node of each link."""
        return {name: number for number, node in enumerate(self.nodes) for name in node.names}

    def children(self, node: int) -> list[int]:
        """The child nodes of a node."""
        return [number for number, other in enumerate(self.nodes) if other.parent == node]

    def below(self, node: int) -> list[int]:
        """A node and all of its descendants."""
        found = [node]
        for number in range(node + 1, len(self.nodes)):
            if self.nodes[number].parent in found:
                found.append(number)
        return found

    def path(self, node: int) -> list[int]:
        """The nodes from the base to a node, inclusive."""
        found = [node]
        while self.nodes[found[-1]].parent >= 0:
            found.append(self.nodes[found[-1]].parent)
        return found[::-1]

    def points(self, nodes: Sequence[int]) -> FloatArray:
        """Points (k, 3), m, of several nodes."""
        return np.concatenate([self.nodes[node].points for node in nodes])


def read_tree(model: Any, *, source: str = "") -> Tree:
    """The tree of a `mujoco.MjModel` in its zero pose. source: for messages. Raises InputError without a base,
    without hinges, or with more than MAX_JOINTS."""
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
    carried: list[list[int]] = [[] for _ in range(len(hinges) + 1)]
    for body in range(1, model.nbody):
        moved = model.body_weldid[body]  # the link above that a joint moves
        last_dof = int(model.body_dofadr[moved] + model.body_dofnum[moved] - 1)
        carried[numbers.get(last_dof, BASE)].append(body)
    if not carried[BASE]:
        raise InputError(
            "a robot without a base: a joint moves its first link",
            where=source,
            found=model.body(1).name,
            next_step="Put a <body> around it that no joint moves, or only a <freejoint>",
        )
    geometries = {geometry.link: geometry for geometry in link_geometries(model)}
    found = []
    for joint, links in zip([-1, *hinges], carried, strict=True):
        links = links or ([int(model.jnt_bodyid[joint])] if joint >= 0 else [])
        shaped = [geometries[link] for link in links if link in geometries]
        centres = [one.centres @ data.xmat[one.link].reshape(3, 3).T + data.xpos[one.link] for one in shaped]
        origin, axis, limits, parent, name = np.zeros(3), UP, (-np.inf, np.inf), -1, ""
        if joint >= 0:
            origin, axis, name = data.xanchor[joint].copy(), data.xaxis[joint].copy(), model.joint(joint).name
            limits = tuple(model.jnt_range[joint].tolist()) if model.jnt_limited[joint] else limits
            parent = numbers.get(int(model.dof_parentid[int(model.jnt_dofadr[joint])]), BASE)
        elif links:
            origin = data.xpos[links[0]].copy()
        names = tuple(model.body(link).name for link in links)
        balls = np.concatenate([np.zeros((0, 3)), *centres])
        radii = np.concatenate([np.zeros(0), *(one.radii for one in shaped)])
        found.append(HingeNode(name, names, parent, axis, origin, *limits, balls, radii))
    around = np.concatenate([node.points for node in found])
    return Tree(tuple(found), float(np.linalg.norm(np.ptp(around, axis=0))))


# The sole: the flat underside of a foot.

STEEPEST = np.cos(np.radians(50.0))
"""Cosine of the largest tilt of a sole in the zero pose."""
ONE_FACE = np.cos(np.radians(8.0))
"""Cosine of the largest angle between the normals of the faces of one underside."""
TOUCHING_M = 0.0015
"""Largest height of a point that touches the ground, m."""
MAX_CORNERS = 16
"""Most corners of the outline in a profile."""
MIN_AREA = 1e-4
"""Smallest underside on which a robot can stand, m^2."""


@dataclass(frozen=True, eq=False)
class FlatUnderside:
    """The underside of a foot in the zero pose. up (3,): normal into the foot. points (k, 3), m: on the ground."""

    up: FloatArray
    points: FloatArray


def flat_underside(tree: Tree, nodes: Sequence[int]) -> FlatUnderside | None:
    """The largest flat underside of these nodes, None if there is none."""
    centres = np.concatenate([tree.nodes[node].centres for node in nodes])
    radii = np.concatenate([tree.nodes[node].radii for node in nodes])
    down = _facing_down(centres, radii) if len(centres) else None
    if down is None:
        return None
    lowest = centres + radii[:, None] * down
    depth = lowest @ down
    touching = lowest[depth >= depth.max() - TOUCHING_M]
    sides = np.ptp(touching @ principal_axes(touching)[:2].T, axis=0)
    return None if sides.prod() < MIN_AREA else FlatUnderside(-down, touching)


def outline(points: FloatArray) -> FloatArray:
    """The points of (n, 2) that are farthest in MAX_CORNERS directions: a convex outline (k, 2),
    counter-clockwise from the front left."""
    angles = np.pi / 4.0 + np.arange(MAX_CORNERS) * (2.0 * np.pi / MAX_CORNERS)
    farthest = np.argmax(points @ np.stack([np.cos(angles), np.sin(angles)]), axis=0)
    return np.asarray(points[list(dict.fromkeys(farthest.tolist()))])


def _facing_down(centres: FloatArray, radii: FloatArray) -> FloatArray | None:
    """Outward normal (3,) of the largest part of the hull that faces down in the zero pose."""
    hull = hull_of_balls(centres, radii, DIRECTIONS[::8])
    if hull is None:
        return np.array([0.0, 0.0, -1.0])
    normals = hull.equations[:, :3]
    corners = hull.points[hull.simplices]
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    down = np.flatnonzero(normals[:, 2] <= -STEEPEST)
    if not len(down):
        return None
    alike = normals[down] @ normals[down].T > ONE_FACE
    sums = alike @ areas[down]
    best = down[alike[int(np.argmax(sums))]]
    normal = (normals[best] * areas[best][:, None]).sum(axis=0)
    return np.asarray(normal / np.linalg.norm(normal))
