"""A body of lines in the picture plane: where its points fall, and its bones drawn from the farthest to the nearest."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Ellipse

from retarget.plots.style import MIDDLE, side_colour
from retarget.rotations import FloatArray

__all__ = ["Bone", "Skeleton", "draw_skeleton", "project", "turned"]

Bone = tuple[str, str]
"""Two points that a line joins."""

AZIMUTH, ELEVATION = np.deg2rad(35.0), np.deg2rad(12.0)
"""Seen from the front left and from slightly above."""
LIMB, THIN, HEAD, SHADOW = 0.045, 0.010, 0.062, 0.24
"""Thickness of a bone, of a recorded one, radius of the head and of the shadow, in heights of the head."""
_TRUNK = ("l_shoulder", "r_shoulder", "r_hip", "l_hip")
_NEAREST = 10.0
"""Layer of what is nearer than everything else could be; depths are a few heights at most."""


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A body in some postures. points (p, k, 3): of `names`, facing x, feet at the origin, the head about 1 high.

    soles: outlines (p, c, 3) on the ground, in the same frame. recorded (p, k, 3): drawn thin and black over it.
    """

    names: tuple[str, ...]
    bones: tuple[Bone, ...]
    points: FloatArray
    soles: tuple[FloatArray, ...] = ()
    recorded: FloatArray | None = None

    def extent(self, pose: int) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of one posture in the picture, all that is drawn included."""
        shown = [self.points[pose], *(sole[pose] for sole in self.soles)]
        if self.recorded is not None:
            shown.append(self.recorded[pose])
        across, up, _ = project(np.concatenate(shown))
        return (
            min(float(np.nanmin(across)) - HEAD, -SHADOW),
            max(float(np.nanmax(across)) + HEAD, SHADOW),
            min(float(np.nanmin(up)) - LIMB, -SHADOW * float(np.sin(ELEVATION))),
            float(np.nanmax(up)) + HEAD,
        )


def turned(points: FloatArray, facing: FloatArray) -> FloatArray:
    """Points (p, k, 3) of a world in which each posture faces (p, 2), as seen by somebody who faces x."""
    x, y = facing[:, :1], facing[:, 1:]
    a, b, c = np.moveaxis(points, -1, 0)
    return np.stack([x * a + y * b, x * b - y * a, c], axis=-1)


def project(points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Across and up in the picture, and how near to the viewer, of points (..., 3): parallel projection."""
    # The viewer stands at AZIMUTH from the x axis; across is to the viewer's right.
    across = -np.sin(AZIMUTH) * points[..., 0] + np.cos(AZIMUTH) * points[..., 1]
    before = np.cos(AZIMUTH) * points[..., 0] + np.sin(AZIMUTH) * points[..., 1]
    up = points[..., 2] * np.cos(ELEVATION) - before * np.sin(ELEVATION)
    return across, up, before * np.cos(ELEVATION) + points[..., 2] * np.sin(ELEVATION)


def draw_skeleton(
    axes: Axes, skeleton: Skeleton, pose: int, *, place: tuple[float, float], points_per_unit: float
) -> None:
    """One posture with its origin at `place`. points_per_unit: typographic points to a unit of the picture."""
    x, y = place
    shadow = Ellipse(
        place, 2.0 * SHADOW, 2.0 * SHADOW * float(np.sin(ELEVATION)), facecolor="#eeeeee", zorder=-_NEAREST
    )
    axes.add_patch(shadow)
    for sole in skeleton.soles:
        across, up, _ = project(sole[pose])
        axes.fill(x + across, y + up, facecolor="#d5d5d5", edgecolor="#a0a0a0", linewidth=0.6, zorder=1.0 - _NEAREST)
    if skeleton.recorded is not None:
        _bones(axes, skeleton, skeleton.recorded[pose], place, "black", THIN * points_per_unit)
    _bones(axes, skeleton, skeleton.points[pose], place, None, LIMB * points_per_unit)
    _trunk(axes, skeleton, skeleton.points[pose], place)
    if "head" in skeleton.names:
        across, up, near = project(skeleton.points[pose, skeleton.names.index("head")])
        if np.isfinite(across):
            axes.add_patch(
                Circle((x + float(across), y + float(up)), HEAD, facecolor=MIDDLE, zorder=float(near) + 2.0 * HEAD)
            )


def _bones(
    axes: Axes, skeleton: Skeleton, points: FloatArray, place: tuple[float, float], colour: str | None, width: float
) -> None:
    """Bones as lines, the nearer over the farther; `colour` None: by side, each with a light rim where it crosses."""
    across, up, near = project(points)
    for start, end in skeleton.bones:
        ends = [skeleton.names.index(start), skeleton.names.index(end)]
        depth = float(np.mean(near[ends]))
        line = (place[0] + across[ends], place[1] + up[ends])
        shade = colour or side_colour(end if end[:2] in ("l_", "r_") else start)
        layer = depth if colour is None else _NEAREST
        if colour is None:
            axes.plot(*line, color="white", linewidth=1.35 * width, solid_capstyle="butt", zorder=layer - 1e-3)
        axes.plot(*line, color=shade, linewidth=width, solid_capstyle="round", zorder=layer)


def _trunk(axes: Axes, skeleton: Skeleton, points: FloatArray, place: tuple[float, float]) -> None:
    """Shoulders and hips as one pale area behind all bones, so that a turn of the trunk is seen."""
    if not set(_TRUNK) <= set(skeleton.names):
        return
    across, up, _ = project(points[[skeleton.names.index(name) for name in _TRUNK]])
    axes.fill(place[0] + across, place[1] + up, facecolor="#c9c9c9", linewidth=0, zorder=-0.4 * _NEAREST)
