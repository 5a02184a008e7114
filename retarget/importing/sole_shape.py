"""The sole: the flat underside that a foot stands on, as the hull of the balls that its geometry is made of."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from retarget.fitting.geometry import directions
from retarget.importing.tree import Tree
from retarget.rotations import FloatArray

__all__ = ["Sole", "flat_underside", "outline"]

STEEPEST = np.cos(np.radians(50.0))
"""A foot is turned no further from flat than this in the zero pose."""
ALIKE = np.cos(np.radians(8.0))
"""Faces whose normals are so near to each other are one underside."""
TOUCHING_M = 0.0015
"""What is so near to the ground touches it."""
ROUNDS = 4
MAX_CORNERS = 16
"""Of the outline in a profile."""
MIN_AREA = 1e-4
"""[m^2] Less is a point or an edge, which nobody stands on."""


@dataclass(frozen=True, eq=False)
class Sole:
    """up (3,): the normal of the sole, into the foot. corners (k, 3) m: of its convex outline, all in the world of the
    zero pose. area, m^2."""

    up: FloatArray
    corners: FloatArray
    area: float


def flat_underside(tree: Tree, nodes: Sequence[int]) -> Sole | None:
    """The largest flat underside of these nodes together; None where they have no geometry that could stand."""
    solid = [node for node in nodes if len(tree.nodes[node].centres)]
    if not solid:
        return None
    centres = np.concatenate([tree.nodes[node].centres for node in solid])
    radii = np.concatenate([tree.nodes[node].radii for node in solid])
    down = _facing_down(centres, radii)
    if down is None:
        return None
    for _ in range(ROUNDS):
        touching = _touching(centres, radii, down)
        if len(touching) < 3:
            return None
        middle = touching.mean(axis=0)
        normal = np.linalg.svd(touching - middle)[2][2]
        normal = normal if normal @ down > 0.0 else -normal
        if normal @ down < ALIKE:
            break
        down = normal
    touching = _touching(centres, radii, down)
    corners, area = outline(touching, -down)
    return None if area < MIN_AREA else Sole(-down, corners, area)


def outline(points: FloatArray, up: FloatArray) -> tuple[FloatArray, float]:
    """Corners (k, 3) of the convex outline of points (n, 3) seen along `up`, counter-clockwise, at most MAX_CORNERS,
    and its area, m^2; no corners and 0 where it is an edge."""
    first = np.cross(up, [1.0, 0.0, 0.0] if abs(up[0]) < 0.8 else [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first)
    flat = points @ np.stack([first, np.cross(up, first)], axis=1)
    try:
        hull = ConvexHull(flat)
    except (QhullError, ValueError):
        return np.zeros((0, 3)), 0.0
    ring = _thinned([int(vertex) for vertex in hull.vertices], flat)
    height = float(np.mean(points @ up))
    level = points[ring] + (height - points[ring] @ up)[:, None] * up
    return np.asarray(level), float(hull.volume)


def _thinned(ring: list[int], flat: FloatArray) -> list[int]:
    """Without the corners whose loss costs least area: those in line, and those beyond MAX_CORNERS."""
    while len(ring) > 3:
        a, b, c = (flat[np.roll(ring, shift)] for shift in (1, 0, -1))
        lost = 0.5 * np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
        least = int(np.argmin(lost))
        if len(ring) <= MAX_CORNERS and lost[least] > 2e-6:
            break
        del ring[least]
    return ring


def _facing_down(centres: FloatArray, radii: FloatArray) -> FloatArray | None:
    """Outward normal (3,) of the largest part of the hull that looks down in the zero pose."""
    ball = directions()[::8]
    surface = np.concatenate(
        [centres[radii == 0.0], *(c + r * ball for c, r in zip(centres, radii, strict=True) if r > 0.0)]
    )
    try:
        hull = ConvexHull(surface)
    except (QhullError, ValueError):
        return np.array([0.0, 0.0, -1.0])
    normals = hull.equations[:, :3]
    corners = surface[hull.simplices]
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    looking = np.flatnonzero(normals[:, 2] <= -STEEPEST)
    if not len(looking):
        return None
    alike = normals[looking] @ normals[looking].T > ALIKE
    sums = alike @ areas[looking]
    best = looking[alike[int(np.argmax(sums))]]
    normal = (normals[best] * areas[best][:, None]).sum(axis=0)
    return np.asarray(normal / np.linalg.norm(normal))


def _touching(centres: FloatArray, radii: FloatArray, down: FloatArray) -> FloatArray:
    """The lowest points (k, 3) of the balls that touch the ground below."""
    lowest = centres + radii[:, None] * down
    depth = lowest @ down
    return np.asarray(lowest[depth >= depth.max() - TOUCHING_M])
