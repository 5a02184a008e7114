"""Obstacles as they are seen: the outline of the solid, and of its zone of influence, under parallel projection."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from retarget.ik.support_polygon import convex_hull
from retarget.model.scene_shapes import ShapeKind
from retarget.model.scene_state import SceneState
from retarget.rotations import rotate
from retarget.schema.scene import Scene
from retarget.types import FloatArray

OBSTACLE, ZONE_SHARE = "#009e73", 0.13
"""Colour of obstacles, and how much of it their zones have."""
BEHIND = -5.0
"""Layer of zones: behind every body."""
SIDES = 72
_ANGLES = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)
_RING = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)

Projection = Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]
"""World points (n, 3) -> across, up, near, each (n,)."""


@dataclass(frozen=True, eq=False)
class Outline:
    """Corners (c, 2) of the solid and of its zone in the picture, and how near its middle is."""

    solid: FloatArray
    zone: FloatArray
    near: float


def scene_outlines(scene: Scene, projection: Projection, *, scale: float = 1.0) -> list[Outline]:
    """Spheres, capsules and cylinders of a scene at time 0. scale: picture units to a metre."""
    state = SceneState(scene)
    shapes, poses = state.shapes, state.at(0.0)
    outlines = []
    for k, kind in enumerate(shapes.kinds.tolist()):
        radius, half = shapes.sizes[k, :2]
        ends = poses.position[k] + np.outer([-half, half], rotate(poses.quat[k], np.array([0.0, 0.0, 1.0])))
        if kind == ShapeKind.CYLINDER:
            rim = rotate(poses.quat[k], radius * np.column_stack([_RING, np.zeros(SIDES)]))
            points, round_by = (ends[:, None] + rim).reshape(-1, 3), 0.0
        elif kind == ShapeKind.CAPSULE:
            points, round_by = ends, float(radius)
        else:
            continue
        across, up, near = projection(points)
        flat = np.stack([across, up], axis=1)
        outlines.append(
            Outline(
                convex_hull(_rounded(flat, scale * round_by)),
                convex_hull(_rounded(flat, scale * (round_by + float(shapes.influence[k])))),
                float(np.mean(near)),
            )
        )
    return outlines


def draw_outline(axes: Axes, outline: Outline, place: tuple[float, float] = (0.0, 0.0)) -> None:
    """A solid with a pale zone round it."""
    zone = Polygon(outline.zone + place, facecolor=OBSTACLE, alpha=ZONE_SHARE, linewidth=0, zorder=BEHIND)
    rim = Polygon(outline.zone + place, fill=False, edgecolor=OBSTACLE, alpha=0.5, linewidth=0.6, linestyle=(0, (4, 3)))
    rim.set_zorder(BEHIND)
    solid = Polygon(outline.solid + place, facecolor=OBSTACLE, edgecolor="#00563f", linewidth=0.8, zorder=outline.near)
    for patch in (zone, rim, solid):
        axes.add_patch(patch)


def _rounded(points: FloatArray, radius: float) -> FloatArray:
    """Points (n, 2) widened by a disc."""
    return points if radius == 0.0 else (points[:, None] + radius * _RING).reshape(-1, 2)
