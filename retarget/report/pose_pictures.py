"""A strip of poses: the performer as reconstructed, and the robot below, at the same instants, facing the same way."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse

from retarget.model.human import PostureReader
from retarget.model.human_dimensions import PARENTS, POINTS
from retarget.report.plot_style import MIDDLE, new_figure, side_colour
from retarget.report.tracking import headings
from retarget.run.run_result import RunResult
from retarget.types import ORIENTED, FloatArray

# A body of lines in the picture plane: where its points fall, and its bones drawn from the farthest to the nearest.

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
        """Left, right, bottom and top, m, of one posture in the picture, all that is drawn included."""
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
    """Turn points (p, k, 3) m of a world in which each posture faces the unit vector (p, 2), as seen by a viewer who
    faces x."""
    x, y = facing[:, :1], facing[:, 1:]
    a, b, c = np.moveaxis(points, -1, 0)
    return np.stack([x * a + y * b, x * b - y * a, c], axis=-1)


def project(points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Project points (..., 3) m in parallel: across and up in the picture, and how near to the viewer, m."""
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


POSES = 9
WIDTH, MOST_PER_HEIGHT, TITLE = 13.5, 1.7, 0.45
"""Inches: of the whole picture, of a body's height at most, and of the title."""
GAP, ROOM = 0.07, 0.12
"""Room between poses and above each line of them, in heights of the head."""
HUMAN_BONES: tuple[Bone, ...] = tuple(
    (POINTS[parent], name) for name, parent in zip(POINTS, PARENTS, strict=True) if parent >= 0
)
"""Pairs of points that a line joins in a picture of the human."""
_LIMBS = (("shoulder", "elbow"), ("elbow", "hand"), ("hip", "knee"), ("knee", "ankle"), ("ankle", "toe"))
ROBOT_BONES: tuple[Bone, ...] = (
    *(("pelvis", "neck"), ("neck", "head")),
    *((f"{side}_{a}", f"{side}_{b}") for side in "lr" for a, b in _LIMBS),
    *(("l_shoulder", "neck"), ("r_shoulder", "neck"), ("l_hip", "pelvis"), ("r_hip", "pelvis")),
)


def plot_poses(run: RunResult) -> Figure | None:
    """The human above, the robot below; of a human alone, the recorded body over the reconstructed one."""
    if run.ticks_followed < 2:
        return None
    following = run.record.following
    count = min(POSES, run.ticks_followed)
    ticks = np.linspace(following.start, following.stop - 1, count).round().astype(int).tolist()
    bodies = [_performer(run, ticks)] if run.robot is None else [_performer(run, ticks), _robot(run, ticks)]
    extents = np.array([[body.extent(pose) for pose in range(len(ticks))] for body in bodies])  # (lines, poses, 4)
    left, right = extents[..., 0].min(axis=0), extents[..., 1].max(axis=0)
    ends = np.cumsum(right - left + GAP)
    places = ends - GAP - right
    bottom, top = extents[..., 2].min(axis=1), extents[..., 3].max(axis=1) + ROOM
    floors = -np.cumsum(top) - np.concatenate([[0.0], np.cumsum(-bottom)[:-1]])
    across, down = float(ends[-1]), float(floors[-1] + bottom[-1])
    inches = min(WIDTH / across, MOST_PER_HEIGHT)
    figure = new_figure(max(inches * across, 6.0), -inches * down + TITLE, _title(run))
    axes = figure.subplots()
    for pose, tick in enumerate(ticks):
        for body, floor in zip(bodies, floors, strict=True):
            place = (float(places[pose]), float(floor))
            draw_skeleton(axes, body, pose, place=place, points_per_unit=72.0 * inches)
        axes.text(
            places[pose], 0.0, f"{run.record.time[tick]:.1f} s", fontsize=9, ha="center", va="top", color="#555555"
        )
    axes.set_xlim(-GAP, across)
    axes.set_ylim(down, 0.0)
    axes.set_aspect("equal")
    axes.set_axis_off()
    return figure


def performer_facing(run: RunResult) -> FloatArray:
    """Heading (t, 2), unit vectors on the ground, in which a robot mirrors the performer at the ticks that followed."""
    human, following = run.record.human, run.record.following
    pelvis = PostureReader(run.human).orientations(np.ascontiguousarray(human.q[following]))
    turns = pelvis[:, ORIENTED.index("pelvis")]
    return headings(turns, human.joint_names, human.joints[following], run.clip.dt)


def bones_among(names: tuple[str, ...], bones: tuple[Bone, ...]) -> tuple[Bone, ...]:
    """The bones of which both ends are known."""
    return tuple(bone for bone in bones if set(bone) <= set(names))


def _title(run: RunResult) -> str:
    sides = "left orange, right blue"
    if run.robot is not None:
        return f"A performer, and {run.robot.profile.name} following ({sides})"
    return f"A performer, reconstructed ({sides})" + ("" if run.human_truth is None else "; thin: as recorded")


def _performer(run: RunResult, ticks: list[int]) -> Skeleton:
    """The reconstructed human, turned to its heading; of a human alone with the recorded one."""
    human, truth = run.record.human, run.human_truth
    names = human.joint_names
    facing = performer_facing(run)[np.array(ticks) - run.record.following.start]
    points = turned(human.joints[ticks], facing)
    feet, size = _feet(points, names), _size(points, names)
    recorded = None
    if truth is not None and run.robot is None:
        recorded = (turned(truth[ticks], facing) - feet) / size
    return Skeleton(names, bones_among(names, HUMAN_BONES), (points - feet) / size, recorded=recorded)


def _robot(run: RunResult, ticks: list[int]) -> Skeleton:
    """The robot as it was sent, with its soles."""
    robot, sent = run.robot, run.record.robot
    assert robot is not None and sent is not None
    names = tuple(robot.profile.frames)
    q = np.ascontiguousarray(sent.q[ticks])
    points = robot.points(q, names)
    feet, size = _feet(points, names), _size(points, names)
    soles = []
    for foot in robot.profile.feet.values():
        link, outline = robot.frame(foot.frame), np.array(foot.polygon)
        local = link.position + np.column_stack([outline, np.zeros(len(outline))])
        soles.append((robot.body.solver_body().points(q, [link.body] * len(local), local) - feet) / size)
    return Skeleton(names, bones_among(names, ROBOT_BONES), (points - feet) / size, soles=tuple(soles))


def _feet(points: FloatArray, names: tuple[str, ...]) -> FloatArray:
    """Where each posture stands (p, 1, 3): on the ground between the feet."""
    feet = [names.index(name) for name in ("l_ankle", "r_ankle") if name in names] or [0]
    centre = points[:, feet].mean(axis=1, keepdims=True)
    centre[..., 2] = 0.0
    return np.asarray(centre)


def _size(points: FloatArray, names: tuple[str, ...]) -> float:
    """Height (m) of the head where it is highest, or of the highest point of a body without head."""
    heights = points[:, names.index("head"), 2] if "head" in names else points[..., 2]
    return max(float(np.nanmax(heights)), 1e-3)
