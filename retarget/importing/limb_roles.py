"""Which joint of a limb does what: hip, knee and ankle across the way of walking; elbow and wrist."""

from dataclasses import dataclass

import numpy as np

from retarget.importing.limbs import Limb
from retarget.importing.tree import Tree
from retarget.rotations import FloatArray

__all__ = ["ArmRoles", "LegRoles", "arm_roles", "crossing", "leg_roles", "tip"]

ACROSS = 0.8
"""Least cosine between an axis and the left of the robot that makes it one of hip, knee or ankle pitch."""
AT_FOOT = 0.25
"""Of a leg's length: a joint so near to its end is at the ankle."""
LEVER = 0.2
"""Of an arm's length: a joint that moves the hand less is a twist or a wrist."""


@dataclass(frozen=True)
class LegRoles:
    """Nodes of the pitch axes of hip, knee and ankle; None where the leg has none."""

    hip: int
    knee: int | None
    ankle: int | None


@dataclass(frozen=True)
class ArmRoles:
    """Nodes of the first shoulder joint, the elbow and the first wrist joint that moves the hand; None: has none."""

    shoulder: int
    elbow: int | None
    wrist: int | None


def leg_roles(tree: Tree, leg: Limb, left: FloatArray) -> LegRoles:
    """By the axes across the robot, from the hip down."""
    across = [node for node in leg.nodes if abs(tree.nodes[node].axis @ left) > ACROSS]
    if not across:
        return LegRoles(leg.nodes[0], None, None)
    floor = tree.points(leg.ends)[:, 2].min()
    heights = {node: float(tree.nodes[node].anchor[2] - floor) for node in across}
    length = max(float(tree.nodes[node].anchor[2] - floor) for node in leg.nodes)
    ankle = across[-1] if len(across) > 1 and heights[across[-1]] < AT_FOOT * length else None
    between = across[1:-1] if ankle is not None else across[1:]
    hip, low = across[0], heights[ankle] if ankle is not None else 0.0
    knee = max(between, key=lambda node: min(heights[hip] - heights[node], heights[node] - low), default=None)
    return LegRoles(hip, knee, ankle)


def arm_roles(tree: Tree, arm: Limb) -> ArmRoles:
    """The elbow is the joint nearest to the middle of the arm that moves the hand; the wrist one behind it."""
    hand = tree.points(arm.ends).mean(axis=0)
    start = tree.nodes[arm.nodes[0]].anchor
    length = sum(
        float(np.linalg.norm(tree.nodes[b].anchor - tree.nodes[a].anchor))
        for a, b in zip(arm.nodes, arm.nodes[1:], strict=False)
    ) + float(np.linalg.norm(hand - tree.nodes[arm.nodes[-1]].anchor))
    outer = [node for node in arm.nodes[1:] if _distance(tree, node, hand) > LEVER * length]
    inner = {node: _distance(tree, node, start) for node in outer}
    elbow = max(outer, key=lambda node: min(inner[node], _distance(tree, node, hand)), default=None)
    if elbow is None or inner[elbow] < LEVER * length:
        return ArmRoles(arm.nodes[0], None, None)
    behind = arm.nodes[arm.nodes.index(elbow) + 1 :]
    forearm = hand - tree.nodes[elbow].anchor
    forearm = forearm / max(float(np.linalg.norm(forearm)), 1e-9)
    wrist = next((node for node in behind if abs(tree.nodes[node].axis @ forearm) < ACROSS), None)
    return ArmRoles(arm.nodes[0], elbow, wrist)


def tip(tree: Tree, arm: Limb, start: FloatArray) -> FloatArray:
    """The middle (3,) of the far end of a hand, seen from `start`."""
    points = tree.points(arm.ends)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    way = middle - start
    length = float(np.linalg.norm(way))
    if length < 1e-6:
        return np.asarray(middle)
    way = way / length
    return np.asarray(start + float(((points - start) @ way).max()) * way)


def crossing(tree: Tree, node: int, other: int) -> FloatArray:
    """The point (3,) of the axis of `node` that is nearest to the axis of `other`; where both are parallel, the one
    nearest to the other's anchor."""
    a, b = tree.nodes[node], tree.nodes[other]
    way, cosine = b.anchor - a.anchor, float(a.axis @ b.axis)
    if 1.0 - cosine * cosine < 1e-3:
        along = float(way @ a.axis)
    else:
        along = float((way @ a.axis - cosine * (way @ b.axis)) / (1.0 - cosine * cosine))
    return np.asarray(a.anchor + along * a.axis)


def _distance(tree: Tree, node: int, point: FloatArray) -> float:
    """Of a point from a node's axis, m."""
    way = point - tree.nodes[node].anchor
    return float(np.linalg.norm(way - (way @ tree.nodes[node].axis) * tree.nodes[node].axis))
