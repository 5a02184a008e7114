"""Strips of postures side by side, as in the paper's Figures 3, 7, 9 and 10: thick limbs, sensors as little boxes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from benchmarks.paper.outlines import Outline, draw_outline, scene_outlines
from benchmarks.paper.skeleton import HEAD, Skeleton, draw_skeleton
from retarget.model.human_dimensions import PARENTS, POINTS
from retarget.pictures.plots import new_figure
from retarget.pictures.solid import AZIMUTH, ELEVATION, Bone, project
from retarget.report.tracking import turned
from retarget.schema.scene import Scene
from retarget.types import FloatArray

WIDTH, MOST_PER_HEIGHT, TITLE = 13.0, 2.0, 0.4
"""Inches: of the picture, of a body's height at most, of the title."""
GAP, ROOM, LABEL = 0.06, 0.10, 0.14
"""Between postures, above a row and for its label, in heights of the head."""
BOX = 0.05
"""Side of the box of a sensor, in heights of the head."""
_BONES: tuple[Bone, ...] = tuple(
    (POINTS[parent], name) for name, parent in zip(POINTS, PARENTS, strict=True) if parent >= 0
)


@dataclass(frozen=True)
class View:
    """How postures are seen.

    facing: where the performer faces, (2,) on the ground. azimuth_deg: from where they are seen: 0 from the front,
    positive from their left. size: m of the world to one unit of the picture. elevation_deg: from how far above.
    """

    facing: tuple[float, float]
    azimuth_deg: float
    size: float
    elevation_deg: float = 12.0

    def flat(self, points: FloatArray, origin: FloatArray) -> FloatArray:
        """World points (p, k, 3) as seen, about an origin (3,) or one for each posture (p, 1, 3)."""
        away = AZIMUTH - np.deg2rad(self.azimuth_deg)
        c, s = np.cos(away), np.sin(away)
        x, y = np.array(self.facing) / np.hypot(*self.facing)
        facing = np.array([[c * x + s * y, c * y - s * x]])
        seen = turned((points - origin) / self.size, np.repeat(facing, len(points), axis=0))
        # `project` looks from ELEVATION: tilt by the rest.
        tilt = ELEVATION - np.deg2rad(self.elevation_deg)
        before = np.cos(AZIMUTH) * seen[..., 0] + np.sin(AZIMUTH) * seen[..., 1]
        back = (np.cos(tilt) - 1.0) * before - np.sin(tilt) * seen[..., 2]
        up = np.cos(tilt) * seen[..., 2] + np.sin(tilt) * before
        level = np.stack([np.cos(AZIMUTH) * back, np.sin(AZIMUTH) * back], axis=-1)
        return np.concatenate([seen[..., :2] + level, up[..., None]], axis=-1)


@dataclass(frozen=True, eq=False)
class Row:
    """One row: a body in p postures, what stands around it, sensors (p, k, 3) as `Skeleton.points`, a label."""

    label: str
    skeleton: Skeleton
    outlines: tuple[Outline, ...] = ()
    sensors: FloatArray | None = None
    captions: tuple[str, ...] = ()

    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom, top of every posture together."""
        poses = np.array([self.skeleton.extent(pose) for pose in range(len(self.skeleton.points))])
        left, right, bottom, top = poses[:, 0].min(), poses[:, 1].max(), poses[:, 2].min(), poses[:, 3].max()
        for outline in self.outlines:
            solid = outline.solid
            left, right = min(left, solid[:, 0].min() - GAP), max(right, solid[:, 0].max() + GAP)
            bottom, top = min(bottom, solid[:, 1].min()), max(top, solid[:, 1].max() + GAP)
        return float(left), float(right), float(bottom), float(top)


def body_row(
    label: str,
    joints: FloatArray,
    view: View,
    origin: FloatArray,
    *,
    scene: Scene | None = None,
    sensors: FloatArray | None = None,
    beside: FloatArray | None = None,
    captions: Sequence[str] = (),
) -> Row:
    """A row of postures: joints (p, m, 3) of `POINTS`; sensors (p, k, 3); beside (p, m, 3): drawn thin over it."""
    skeleton = Skeleton(POINTS, _BONES, view.flat(joints, origin))
    if beside is not None:
        skeleton = replace(skeleton, recorded=view.flat(beside, origin))
    outlines: list[Outline] = []
    if scene is not None:
        outlines = scene_outlines(
            scene, lambda points: project(view.flat(points[None], origin)[0]), scale=1.0 / view.size
        )
    return Row(
        label, skeleton, tuple(outlines), None if sensors is None else view.flat(sensors, origin), tuple(captions)
    )


def draw_strips(title: str, rows: Sequence[Row]) -> Figure:
    """The rows, one below the other."""
    extents = np.array([row.extent() for row in rows])
    left, right = float(extents[:, 0].min()), float(extents[:, 1].max())
    step = right - left + GAP
    poses = max(len(row.skeleton.points) for row in rows)
    beyond = max((float(outline.zone[:, 0].max()) - right for row in rows for outline in row.outlines), default=0.0)
    heights = extents[:, 3] - extents[:, 2] + ROOM + 2.0 * LABEL
    across = poses * step + max(0.0, beyond)
    inches = min(WIDTH / across, MOST_PER_HEIGHT)
    figure = new_figure(inches * across, inches * float(heights.sum()) + TITLE, title)
    axes = figure.subplots()
    y = 0.0
    for row, (_, _, bottom, _), height in zip(rows, extents.tolist(), heights.tolist(), strict=True):
        floor = y - height - bottom + LABEL
        axes.text(left, y - 0.02, row.label, fontsize=9, va="top", color="#333333", zorder=30)
        for pose in range(len(row.skeleton.points)):
            _draw_pose(axes, row, pose, (pose * step, floor), 72.0 * inches)
            if row.captions:
                caption, at = row.captions[pose], (pose * step, floor + bottom - 0.03)
                axes.text(*at, caption, fontsize=8, ha="center", va="top", color="#555555", zorder=30)
        y -= height
    axes.set_xlim(left - GAP, left - GAP + across)
    axes.set_ylim(y, 0.0)
    axes.set_aspect("equal")
    axes.set_axis_off()
    return figure


def _draw_pose(axes: Axes, row: Row, pose: int, place: tuple[float, float], points_per_unit: float) -> None:
    for outline in row.outlines:
        draw_outline(axes, outline, place)
    draw_skeleton(axes, row.skeleton, pose, place=place, points_per_unit=points_per_unit)
    if row.skeleton.recorded is not None:
        across, up, _ = project(row.skeleton.recorded[pose, POINTS.index("head")])
        at = (place[0] + float(across), place[1] + float(up))
        axes.add_patch(Circle(at, HEAD, fill=False, edgecolor="black", linewidth=1.2, zorder=20))
    if row.sensors is None:
        return
    across, up, _ = project(row.sensors[pose])
    for x, y in zip(across.tolist(), up.tolist(), strict=True):
        corner = (place[0] + x - 0.5 * BOX, place[1] + y - 0.5 * BOX)
        axes.add_patch(Rectangle(corner, BOX, BOX, facecolor="#f0e442", edgecolor="black", linewidth=0.8, zorder=20))
