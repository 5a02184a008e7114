"""What moves in a body, as a tree of hinges in its zero pose: lines of axes, and the geometry that each carries."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from retarget.errors import InputError
from retarget.fitting.geometry import link_geometries
from retarget.rotations import FloatArray

__all__ = ["BASE", "Node", "Tree", "read_tree"]

BASE = 0
"""Number of the node that no joint moves: the base."""
MAX_JOINTS = 250
"""A profile holds no more servos."""


@dataclass(frozen=True, eq=False)
class Node:
    """A hinge and the links that it carries rigidly, or the base.

    joint: its name, empty for the base. parent: number of a node, -1 for the base. axis, anchor (3,): direction and a
    point of its axis. links: numbers of bodies, the moved one first; its last one carries the next hinges too. centres
    (k, 3), radii (k,): balls whose hull is the geometry. All in the world of the zero pose, m.
    """

    joint: str
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
        """Where it is, (k, 3): its geometry, or else the anchor of its axis."""
        return self.centres if len(self.centres) else self.anchor[None]


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
        """Where nodes are, (k, 3) m."""
        return np.concatenate([self.nodes[node].points for node in nodes])


def read_tree(model: Any, *, source: str = "") -> Tree:
    """The tree of a compiled `mujoco.MjModel` in its zero pose; source names it in messages.

    Raises InputError: joints that no servo turns, or none that one turns.
    """
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    hinges = [index for index in range(model.njnt) if model.jnt_type[index] == mujoco.mjtJoint.mjJNT_HINGE]
    _refuse_others(model, hinges, source)
    last: dict[int, int] = {}  # body -> node of its last hinge
    nodes = [(-1, -1)]  # joint, parent
    for joint in hinges:
        body = int(model.jnt_bodyid[joint])
        nodes.append((joint, last[body] if body in last else _node_above(model, last, body)))
        last[body] = len(nodes) - 1
    carried: dict[int, list[int]] = {number: [] for number in range(len(nodes))}
    for body in range(1, model.nbody):
        carried[last[body] if body in last else _node_above(model, last, body)].append(body)
    balls = _balls(model, data)
    found = tuple(
        _node(model, data, joint, parent, carried[number], balls) for number, (joint, parent) in enumerate(nodes)
    )
    around = np.concatenate([node.points for node in found])
    return Tree(found, float(np.linalg.norm(np.ptp(around, axis=0))))


def _refuse_others(model: Any, hinges: list[int], source: str) -> None:
    import mujoco

    allowed = {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_FREE)}
    others = [model.joint(index).name for index in range(model.njnt) if int(model.jnt_type[index]) not in allowed]
    if others:
        raise InputError(
            "joints that no servo turns",
            where=source,
            found=f"sliding or ball joints: {', '.join(others[:10])}",
            allowed="hinges",
            next_step="Make them fixed in the file, or give --freeze",
        )
    if not 1 <= len(hinges) <= MAX_JOINTS:
        raise InputError(
            "no robot of servos",
            where=source,
            found=f"{len(hinges)} hinges",
            allowed=f"1 to {MAX_JOINTS}",
            next_step="Give the body of a whole robot, whose moving joints are revolute or continuous (MJCF: hinge)",
        )


def _node_above(model: Any, last: dict[int, int], body: int) -> int:
    while body > 0:
        body = int(model.body_parentid[body])
        if body in last:
            return last[body]
    return BASE


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
    base = np.array(data.xpos[links[0]]) if links else np.zeros(3)
    limited = joint >= 0 and bool(model.jnt_limited[joint])
    body = int(model.jnt_bodyid[joint]) if joint >= 0 else -1
    return Node(
        joint=model.joint(joint).name if joint >= 0 else "",
        parent=parent,
        axis=np.array(data.xaxis[joint]) if joint >= 0 else np.array([0.0, 0.0, 1.0]),
        anchor=np.array(data.xanchor[joint]) if joint >= 0 else base,
        links=tuple(links) if links else ((body,) if body >= 0 else ()),
        lower=float(model.jnt_range[joint, 0]) if limited else -np.inf,
        upper=float(model.jnt_range[joint, 1]) if limited else np.inf,
        centres=np.concatenate([part[0] for part in parts]) if parts else np.zeros((0, 3)),
        radii=np.concatenate([part[1] for part in parts]) if parts else np.zeros(0),
    )
