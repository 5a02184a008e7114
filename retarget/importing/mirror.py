"""Left and right: the plane that mirrors a robot onto itself, and which joint is whose mirror image.

Only lines of axes and the places of what they carry are compared, so names and link frames do not matter.
"""

from dataclasses import dataclass

import numpy as np

from retarget.importing.tree import BASE, Tree
from retarget.rotations import FloatArray

__all__ = ["Mirror", "find_mirror"]

TOLERANCE = 0.03
"""Of the robot's size: so far a mirrored part may be from its counterpart."""
PARALLEL = 0.97
"""Least cosine between a mirrored axis and its counterpart."""
NORMALS = (np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]))
"""A robot looks along x (REP-103), or along y."""


@dataclass(frozen=True, eq=False)
class Mirror:
    """The plane normal @ point = offset (m), and `partner[node]`: the node's mirror image, itself in the middle.

    What has none is in neither. sign[node]: 1 or -1; mirrored postures have the angle times it at the partner.
    """

    normal: FloatArray
    offset: float
    partner: dict[int, int]
    sign: dict[int, float]

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
    best: tuple[int, Mirror] | None = None
    for normal in NORMALS:
        for offset in _offsets(tree, normal):
            mirror = _matched(tree, normal, offset)
            count = len(mirror.partner)
            if mirror.pairs(tree) and (best is None or count > best[0]):
                best = (count, mirror)
    return None if best is None else best[1]


def _offsets(tree: Tree, normal: FloatArray) -> list[float]:
    """Where the plane may be: through the base's origin, or mid-way between two branches of one node."""
    found = [float(tree.nodes[BASE].anchor @ normal)]
    for node in range(len(tree.nodes)):
        marks = [float(_mark(tree, child) @ normal) for child in tree.children(node)]
        found += [0.5 * (first + second) for place, first in enumerate(marks) for second in marks[:place]]
    return found[:200]


def _matched(tree: Tree, normal: FloatArray, offset: float) -> Mirror:
    mirror = Mirror(normal, offset, {BASE: BASE}, {BASE: 1.0})
    waiting = [(BASE, BASE)]
    while waiting:
        node, other = waiting.pop()
        theirs = tree.children(other)
        costs = [
            (cost, mine, their)
            for mine in tree.children(node)
            for their in theirs
            if (cost := _apart(tree, mirror, mine, their)) is not None
        ]
        for _, mine, their in sorted(costs):
            if mine in mirror.partner or their in mirror.partner:
                continue
            sign = _sign(tree, normal, mine, their)
            mirror.partner.update({mine: their, their: mine})
            mirror.sign.update({mine: sign, their: sign})
            waiting.append((mine, their))
    return mirror


def _apart(tree: Tree, mirror: Mirror, node: int, other: int) -> float | None:
    """How far (m) a node's mirror image is from another node; None where they are no images of each other."""
    mine, theirs, normal = tree.nodes[node], tree.nodes[other], mirror.normal
    most = TOLERANCE * tree.size
    axis = mine.axis - 2.0 * (mine.axis @ normal) * normal
    if abs(axis @ theirs.axis) < PARALLEL:
        return None
    way = _image(mine.anchor, mirror) - theirs.anchor
    line = float(np.linalg.norm(way - (way @ theirs.axis) * theirs.axis))
    mark = float(np.linalg.norm(_image(_mark(tree, node), mirror) - _mark(tree, other)))
    return mark if line <= most and mark <= most else None


def _image(point: FloatArray, mirror: Mirror) -> FloatArray:
    return np.asarray(point - 2.0 * (point @ mirror.normal - mirror.offset) * mirror.normal)


def _mark(tree: Tree, node: int) -> FloatArray:
    """Where a branch is: the mean of the middles of its parts."""
    middles = [0.5 * (tree.nodes[n].points.min(axis=0) + tree.nodes[n].points.max(axis=0)) for n in tree.below(node)]
    return np.asarray(np.mean(middles, axis=0))


def _sign(tree: Tree, normal: FloatArray, node: int, other: int) -> float:
    """A turn is a pseudovector: its mirror image is minus that of its axis."""
    axis = tree.nodes[node].axis
    return 1.0 if (2.0 * (axis @ normal) * normal - axis) @ tree.nodes[other].axis > 0.0 else -1.0
