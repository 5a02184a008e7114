"""The obstacles of a scene as edges, so that the page shows what the body had to keep clear of."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from retarget import rotations
from retarget.rotations import FloatArray
from retarget.scene_motion import SceneState
from retarget.scene_shapes import ShapeKind

__all__ = ["Wires", "wires_of"]

ROUND = 12
"""Corners of a circle."""


@dataclass(frozen=True, eq=False)
class Wires:
    """points (R, p, 3) m, world: a row for each time, or a single one where nothing moves. edges: pairs of points."""

    points: FloatArray
    edges: tuple[tuple[int, int], ...]


def wires_of(scene: SceneState, times: FloatArray) -> Wires | None:
    """The obstacles at times (T,) s; None without any that has edges. A half-space has none: it is the ground, or a
    wall without an end."""
    local, owners, edges = _outlines(scene)
    if not owners:
        return None
    poses = [scene.at_rest(float(time)) for time in times]
    place = np.array([pose.position[owners] for pose in poses])
    turn = np.array([pose.quat[owners] for pose in poses])
    points = place + rotations.rotate(turn, np.array(local)[None])
    moves = bool(np.ptp(points, axis=0).max() > 0.0)
    return Wires(points if moves else points[:1], tuple(edges))


def _outlines(scene: SceneState) -> tuple[list[FloatArray], list[int], list[tuple[int, int]]]:
    """Points in the canonical frames of their obstacles, whose each is, and edges."""
    points: list[FloatArray] = []
    owners: list[int] = []
    edges: list[tuple[int, int]] = []
    for obstacle, (kind, size) in enumerate(zip(scene.shapes.kinds.tolist(), scene.shapes.sizes, strict=True)):
        first = len(points)
        if kind == ShapeKind.BOX:
            corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size
            found = [(a, b) for a in range(8) for b in (a + 1, a + 2, a + 4) if b < 8 and (a ^ b).bit_count() == 1]
        elif kind in (ShapeKind.CAPSULE, ShapeKind.CYLINDER):
            corners, found = _round(float(size[0]), float(size[1]))
        else:
            continue
        points += list(corners)
        owners += [obstacle] * len(corners)
        edges += [(first + a, first + b) for a, b in found]
    return points, owners, edges


def _round(radius: float, half: float) -> tuple[FloatArray, list[tuple[int, int]]]:
    """A circle at both ends and one upright; of a sphere all three are around its middle."""
    angle = np.linspace(0.0, 2.0 * np.pi, ROUND, endpoint=False)
    across, along, flat = radius * np.cos(angle), radius * np.sin(angle), np.zeros(ROUND)
    rings = [np.column_stack([across, along, flat + end]) for end in (-half, half)]
    rings.append(np.column_stack([across, flat, along + half * np.sign(np.round(along, 12))]))
    ring = [*range(ROUND), 0]
    return np.vstack(rings), [(ROUND * i + a, ROUND * i + b) for i in range(len(rings)) for a, b in pairwise(ring)]
