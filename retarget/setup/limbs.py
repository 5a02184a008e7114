"""Which branches of a robot are its legs, its arms and its head, and which way it faces."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from retarget.setup.tree import BASE, TOLERANCE, Mirror, Tree, find_mirror, flat_underside, side_of
from retarget.types import FloatArray

UP = np.array([0.0, 0.0, 1.0])
HIPS = 0.6
"""Share of the trunk's height: legs begin no higher."""
LOW = 0.1
"""Share of the robot's height: feet end so near to its lowest point."""
FINGERS = 0.3
"""Share of a limb's length: branches that reach no further are fingers, and the limb ends before them."""
LEAST_LEG, LEAST_ARM = 2, 2
"""Joints that make a leg, and an arm."""


@dataclass(frozen=True)
class Limb:
    """nodes: of its hinges, from the trunk outwards. parent: the node that it hangs on. ends: its last node and what
    hangs on that: the foot, or the hand with its fingers."""

    nodes: tuple[int, ...]
    parent: int
    ends: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Anatomy:
    """Limbs of a robot.

    forward, left (3,): the robot's axes in its zero pose, z up. legs, arms: left and right one, or none; an arm alone
    is one. pelvis, chest: nodes that carry legs and arms. head: nodes of the neck and head, from the chest on, or
    empty. facing: by what `forward` was found. odd: joints without a counterpart. named: what only names say, for the
    user.
    """

    forward: FloatArray
    left: FloatArray
    mirror: Mirror | None
    legs: tuple[Limb, ...]
    arms: tuple[Limb, ...]
    pelvis: int
    chest: int
    head: tuple[int, ...]
    facing: str
    odd: tuple[str, ...]
    named: tuple[str, ...] = ()

    @property
    def axes(self) -> FloatArray:
        """Unit vectors forward, left and up as columns (3, 3)."""
        return np.stack([self.forward, self.left, UP], axis=1)


def find_anatomy(tree: Tree) -> Anatomy:
    """Legs, arms and head of a body, by its topology and geometry; names only help to distinguish left from right, and
    where the geometry of the two sides differs."""
    mirror = find_mirror(tree)
    if mirror is None:
        arm = _limb(tree, max(tree.children(BASE), key=lambda child: len(tree.below(child))))
        forward, left = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
        alone = (arm,) if len(arm.nodes) >= LEAST_ARM else ()
        return Anatomy(forward, left, None, (), alone, BASE, BASE, (), "assumed: x is forward", ())
    pairs = [(_limb(tree, a), _limb(tree, b)) for a, b in mirror.pairs(tree)]
    legs = _legs(tree, pairs, [node for node, other in mirror.partner.items() if node == other])
    rest = [pair for pair in pairs if pair != legs and len(pair[0].nodes) >= LEAST_ARM]
    arms = max(rest, key=lambda pair: _span(tree, pair[0].nodes[0]), default=None)
    forward, facing = _forward(tree, mirror, legs, arms)
    left = np.cross(UP, forward)
    pelvis = legs[0].parent if legs else BASE
    chest = arms[0].parent if arms else BASE
    turned = bool(left @ mirror.normal < 0.0)
    return Anatomy(
        forward=forward,
        left=left,
        mirror=mirror,
        legs=_sides(legs, turned),
        arms=_sides(arms, turned),
        pelvis=pelvis,
        chest=chest,
        head=_head(tree, mirror, chest, pelvis),
        facing=facing,
        odd=tuple(node.joint for number, node in enumerate(tree.nodes) if number not in mirror.partner),
        named=tuple(_named_only(tree, mirror)),
    )


def _named_only(tree: Tree, mirror: Mirror) -> Iterator[str]:
    """Limbs that are left and right, or in the middle, by name alone, and how far they are from a mirror image."""
    most = 1e3 * TOLERANCE * tree.size
    for node, off in mirror.by_name.items():
        other = mirror.partner[node]
        if node <= other and tree.nodes[node].parent not in mirror.by_name:
            names = " and ".join(tree.nodes[number].joint for number in sorted({node, other}))
            what = "it carries: in the middle" if node == other else "they carry: left and right"
            allowed = f"{most:.0f} mm are allowed, and parallel axes"
            yield f"{names} and what {what} by name, {1e3 * off:.0f} mm from a mirror image ({allowed})"


def _sides(pair: tuple[Limb, Limb] | None, turned: bool) -> tuple[Limb, ...]:
    return () if pair is None else pair[::-1] if turned else pair


def _limb(tree: Tree, first: int) -> Limb:
    """From its first node outwards, to where it ends in fingers or in nothing."""
    nodes, length = [first], 0.0
    while branches := tree.children(nodes[-1]):
        spans = [_span(tree, branch) for branch in branches]
        onward = branches[int(np.argmax(spans))]
        length += float(np.linalg.norm(tree.nodes[onward].anchor - tree.nodes[nodes[-1]].anchor))
        if len(branches) > 1 and max(spans) < FINGERS * (length + max(spans)):
            break
        nodes.append(onward)
    return Limb(tuple(nodes), tree.nodes[first].parent, tuple(tree.below(nodes[-1])))


def _span(tree: Tree, branch: int) -> float:
    """How far (m) a branch reaches from its first axis."""
    return float(np.linalg.norm(tree.points(tree.below(branch)) - tree.nodes[branch].anchor, axis=1).max())


def _legs(tree: Tree, pairs: list[tuple[Limb, Limb]], trunk: list[int]) -> tuple[Limb, Limb] | None:
    """The pair that ends at the bottom of the robot and begins low on its trunk; arms that hang begin high up."""
    heights = tree.points(range(len(tree.nodes)))[:, 2]
    floor, height = float(heights.min()), float(np.ptp(heights))
    middle = tree.points(trunk)[:, 2]
    highest = float(middle.min()) + HIPS * float(np.ptp(middle))
    standing = []
    for pair in pairs:
        root = float(tree.nodes[pair[0].nodes[0]].anchor[2])
        low = float(tree.points(pair[0].ends)[:, 2].min())
        if len(pair[0].nodes) >= LEAST_LEG and low <= floor + LOW * height < root + 1e-9 and root <= highest + 1e-9:
            standing.append(pair)
    return min(standing, key=lambda pair: tree.nodes[pair[0].nodes[0]].anchor[2], default=None)


def _head(tree: Tree, mirror: Mirror, chest: int, pelvis: int) -> tuple[int, ...]:
    """The branch in the middle that reaches highest, from the chest on, and is neither chest nor pelvis."""
    ways = {*tree.way(chest), *tree.way(pelvis)}
    middle = [node for node, other in mirror.partner.items() if node == other and node not in ways]
    first = [node for node in middle if tree.nodes[node].parent in ways]
    above = [
        node for node in first if tree.points(tree.below(node))[:, 2].max() > tree.nodes[chest].points[:, 2].mean()
    ]
    if not above:
        return ()
    nodes = [max(above, key=lambda node: float(tree.points(tree.below(node))[:, 2].max()))]
    while onward := [child for child in tree.children(nodes[-1]) if child in middle]:
        nodes.append(onward[0])
    return tuple(nodes)


def _forward(
    tree: Tree, mirror: Mirror, legs: tuple[Limb, Limb] | None, arms: tuple[Limb, Limb] | None
) -> tuple[FloatArray, str]:
    """Forward (3,), and by what it was found: of the two directions in the mirror plane, that with more evidence."""
    ahead = np.cross(mirror.normal, UP)  # forward, if the normal points left
    evidence = [(3.0 * _named(tree, mirror), "names of left and right")]
    if legs is not None:
        evidence.append((2.0 * _feet_ahead(tree, legs[0], ahead), "feet, longer ahead of the ankle"))
    if arms is not None:
        evidence.append((_hands_ahead(tree, arms[0], ahead), "hands, ahead of the shoulders"))
    total = sum(weight for weight, _ in evidence)
    if total == 0.0:
        usual = ahead if ahead @ np.array([1.0, 1.0, 0.0]) > 0.0 else -ahead
        return usual, "assumed, as the body does not show front and back"
    reasons = ", ".join(text for weight, text in evidence if weight * total > 0.0)
    return (ahead if total > 0.0 else -ahead), reasons


def _named(tree: Tree, mirror: Mirror) -> float:
    """1 where names say that the normal points left, -1 where right, 0 where they say nothing or both."""
    votes = 0
    for first, second in mirror.pairs(tree):
        votes += side_of(tree.nodes[first])[0] - side_of(tree.nodes[second])[0]
    return float(np.sign(votes))


def _feet_ahead(tree: Tree, leg: Limb, ahead: FloatArray) -> float:
    """1 where the middle of the sole is ahead of the last joint across it, -1 where behind, else 0."""
    sole = flat_underside(tree, leg.ends)
    pitches = pitch_joints(tree, leg, np.cross(UP, ahead))
    if sole is None or not pitches:
        return 0.0
    along = sole.points @ ahead
    middle = 0.5 * (along.min() + along.max())
    share = (middle - tree.nodes[pitches[-1]].anchor @ ahead) / max(float(np.ptp(along)), 1e-6)
    return float(np.sign(share)) if abs(share) > 0.02 else 0.0


def _hands_ahead(tree: Tree, arm: Limb, ahead: FloatArray) -> float:
    """1 where the hand is well ahead of the shoulder, -1 where behind, else 0."""
    way = float((tree.points(arm.ends).mean(axis=0) - tree.nodes[arm.nodes[0]].anchor) @ ahead)
    return float(np.sign(way)) if abs(way) > 0.2 * _span(tree, arm.nodes[0]) else 0.0


# Which joint of a limb does what: hip, knee and ankle across the way of walking; elbow and wrist.

ACROSS = 0.8
"""Least cosine between an axis and the left of the robot that makes it one of hip, knee or ankle pitch."""
AT_FOOT = 0.25
"""Share of a leg's length: a joint so near to its end is at the ankle."""
LEVER = 0.2
"""Share of an arm's length: a joint that moves the hand less is a twist or a wrist."""


@dataclass(frozen=True)
class LegRoles:
    """Nodes of the pitch axes of hip, knee and ankle; None where the leg has none."""

    hip: int
    knee: int | None
    ankle: int | None


@dataclass(frozen=True)
class ArmRoles:
    """Nodes of the elbow and of the first wrist joint that moves the hand; None: has none."""

    elbow: int | None
    wrist: int | None


def pitch_joints(tree: Tree, leg: Limb, left: FloatArray) -> list[int]:
    """Find the nodes of the axes across the robot, from the hip down. left (3,): of the robot, or its opposite."""
    return [node for node in leg.nodes if abs(tree.nodes[node].axis @ left) > ACROSS]


def leg_roles(tree: Tree, leg: Limb, left: FloatArray) -> LegRoles:
    """Roles of the joints of a leg, by the axes across the robot, from the hip down."""
    across = pitch_joints(tree, leg, left)
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
    way = np.array([*(tree.nodes[node].anchor for node in arm.nodes), hand])
    length = float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
    outer = [node for node in arm.nodes[1:] if tree.nodes[node].distance(hand) > LEVER * length]
    inner = {node: tree.nodes[node].distance(start) for node in outer}
    elbow = max(outer, key=lambda node: min(inner[node], tree.nodes[node].distance(hand)), default=None)
    if elbow is None or inner[elbow] < LEVER * length:
        return ArmRoles(None, None)
    behind = arm.nodes[arm.nodes.index(elbow) + 1 :]
    forearm = hand - tree.nodes[elbow].anchor
    forearm = forearm / max(float(np.linalg.norm(forearm)), 1e-9)
    wrist = next((node for node in behind if abs(tree.nodes[node].axis @ forearm) < ACROSS), None)
    return ArmRoles(elbow, wrist)


def tip(tree: Tree, arm: Limb, start: FloatArray) -> FloatArray:
    """Middle (3,) m of the far end of a hand, seen from `start`."""
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
