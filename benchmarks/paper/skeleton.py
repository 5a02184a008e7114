"""Bodies of lines: thick bones, drawn from the farthest to the nearest, as in the paper's figures."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Ellipse

from retarget.pictures.plots import side_colour
from retarget.pictures.solid import ELEVATION, Bone, project
from retarget.types import FloatArray

INK = "#333333"
LIMB, THIN, HEAD, SHADOW = 0.045, 0.010, 0.062, 0.24
"""Thickness of a bone, of a recorded one, radius of the head and of the shadow, in heights of the head."""
_TRUNK = ("l_shoulder", "r_shoulder", "r_hip", "l_hip")
_NEAREST = 10.0
"""Layer of what is nearer than everything else could be; depths are a few heights at most."""


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A body in some postures. points (p, k, 3): of `names`, facing x, feet at the origin, the head about 1 high.

    recorded (p, k, 3): drawn thin and black over it.
    """

    names: tuple[str, ...]
    bones: tuple[Bone, ...]
    points: FloatArray
    recorded: FloatArray | None = None

    def extent(self, pose: int) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of one posture in the picture, all that is drawn included."""
        shown = [self.points[pose]] if self.recorded is None else [self.points[pose], self.recorded[pose]]
        across, up, _ = project(np.concatenate(shown))
        return (
            min(float(np.nanmin(across)) - HEAD, -SHADOW),
            max(float(np.nanmax(across)) + HEAD, SHADOW),
            min(float(np.nanmin(up)) - LIMB, -SHADOW * float(np.sin(ELEVATION))),
            float(np.nanmax(up)) + HEAD,
        )


def draw_skeleton(
    axes: Axes, skeleton: Skeleton, pose: int, *, place: tuple[float, float], points_per_unit: float
) -> None:
    """One posture with its origin at `place`. points_per_unit: typographic points to a unit of the picture."""
    x, y = place
    shadow = Ellipse(
        place, 2.0 * SHADOW, 2.0 * SHADOW * float(np.sin(ELEVATION)), facecolor="#eeeeee", zorder=-_NEAREST
    )
    axes.add_patch(shadow)
    if skeleton.recorded is not None:
        across, up, _ = project(skeleton.recorded[pose])
        for ends in ([skeleton.names.index(a), skeleton.names.index(b)] for a, b in skeleton.bones):
            axes.plot(x + across[ends], y + up[ends], color="black", linewidth=THIN * points_per_unit, zorder=_NEAREST)
    _bones(axes, skeleton, skeleton.points[pose], place, LIMB * points_per_unit)
    _trunk(axes, skeleton, skeleton.points[pose], place)
    if "head" in skeleton.names:
        across, up, near = project(skeleton.points[pose, skeleton.names.index("head")])
        if np.isfinite(across):
            axes.add_patch(
                Circle((x + float(across), y + float(up)), HEAD, facecolor=INK, zorder=float(near) + 2.0 * HEAD)
            )


def _bones(axes: Axes, skeleton: Skeleton, points: FloatArray, place: tuple[float, float], width: float) -> None:
    """Bones as lines in the colours of their sides, the nearer over the farther, with a light rim where they cross."""
    across, up, near = project(points)
    for start, end in skeleton.bones:
        ends = [skeleton.names.index(start), skeleton.names.index(end)]
        depth = float(np.mean(near[ends]))
        line = (place[0] + across[ends], place[1] + up[ends])
        shade = side_colour(end if end[:2] in ("l_", "r_") else start)
        axes.plot(*line, color="white", linewidth=1.35 * width, solid_capstyle="butt", zorder=depth - 1e-3)
        axes.plot(*line, color=shade, linewidth=width, solid_capstyle="round", zorder=depth)


def _trunk(axes: Axes, skeleton: Skeleton, points: FloatArray, place: tuple[float, float]) -> None:
    """Shoulders and hips as one pale area behind all bones, so that a turn of the trunk is seen."""
    if not set(_TRUNK) <= set(skeleton.names):
        return
    across, up, _ = project(points[[skeleton.names.index(name) for name in _TRUNK]])
    axes.fill(place[0] + across, place[1] + up, facecolor="#c9c9c9", linewidth=0, zorder=-0.4 * _NEAREST)
