"""A strip of poses: the performer as reconstructed, and the robot below, at the same instants."""

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from retarget.human_dimensions import PARENTS, POINTS
from retarget.plots.style import ASKED, MIDDLE, new_figure, side_colour
from retarget.rotations import FloatArray
from retarget.run_result import RunResult

__all__ = ["plot_poses", "telling_ticks"]

POSES = 9
AZIMUTH, ELEVATION = np.deg2rad(35.0), np.deg2rad(12.0)
"""Seen from the front left and from slightly above."""
_PARENT = {name: POINTS[parent] for name, parent in zip(POINTS, PARENTS, strict=True) if parent >= 0}
_ROBOT_BONES = (
    *(("pelvis", "neck"), ("neck", "head")),
    *((f"{side}_{a}", f"{side}_{b}") for side in "lr" for a, b in (("shoulder", "elbow"), ("elbow", "hand"))),
    *(
        (f"{side}_{a}", f"{side}_{b}")
        for side in "lr"
        for a, b in (("hip", "knee"), ("knee", "ankle"), ("ankle", "toe"))
    ),
    *(("l_shoulder", "neck"), ("r_shoulder", "neck"), ("l_hip", "pelvis"), ("r_hip", "pelvis")),
)


def plot_poses(run: RunResult) -> Figure | None:
    """The human above, the robot below; of a human alone, the recorded body behind the reconstructed one."""
    if run.ticks_followed < 2:
        return None
    ticks = telling_ticks(run)
    name = "human" if run.robot is None else run.robot.profile.name
    lines = 1 if run.robot is None else 2
    figure = new_figure(1.5 * len(ticks) + 0.4, 1.85 * lines + 0.6, _title(run, name))
    grid = figure.subplots(lines, len(ticks), squeeze=False)
    _draw_humans(grid[0], run, ticks)
    if run.robot is not None:
        _draw_robots(grid[1], run, ticks)
    for axes, tick in zip(grid[0], ticks, strict=True):
        axes.set_title(f"{run.record.time[tick]:.1f} s", fontsize=9)
    return figure


def telling_ticks(run: RunResult) -> list[int]:
    """Rows to show: of the parts of the clip in turn, where the hands are highest and where the head is lowest."""
    following = run.record.following
    names, joints = run.record.human.joint_names, run.record.human.joints[following]
    hands = joints[:, [names.index("l_wrist"), names.index("r_wrist")], 2].max(axis=1)
    telling = (hands, -joints[:, names.index("head"), 2])
    edges = np.linspace(0, len(joints), min(POSES, len(joints)) + 1).astype(int)
    return [
        following.start + int(first + np.argmax(telling[part % 2][first:last]))
        for part, (first, last) in enumerate(pairwise(edges))
    ]


def _title(run: RunResult, name: str) -> str:
    sides = "left orange, right blue"
    if run.robot is not None:
        return f"performer, and {name} following ({sides})"
    return f"performer reconstructed ({sides})" + ("" if run.human_truth is None else "; grey: as recorded")


def _draw_humans(line: Sequence[Axes], run: RunResult, ticks: list[int]) -> None:
    human, truth = run.record.human, run.human_truth
    bones = [(_PARENT[name], name) for name in human.joint_names if _PARENT.get(name) in human.joint_names]
    joints = human.joints[ticks]
    centre = _centres(joints, human.joint_names)
    size = float(np.nanmax(joints[..., 2]))
    for axes, tick, middle in zip(line, ticks, centre, strict=True):
        if truth is not None and run.robot is None:
            _skeleton(axes, truth[tick] - middle, human.joint_names, bones, colour=ASKED)
        _skeleton(axes, human.joints[tick] - middle, human.joint_names, bones)
        _frame_picture(axes, size)


def _draw_robots(line: Sequence[Axes], run: RunResult, ticks: list[int]) -> None:
    robot, sent = run.robot, run.record.robot
    assert robot is not None and sent is not None
    names = tuple(robot.profile.frames)
    joints = robot.points(sent.q[ticks], names)
    bones = [(a, b) for a, b in _ROBOT_BONES if a in names and b in names]
    size = float(np.nanmax(joints[..., 2]))
    for axes, tick, points, middle in zip(line, ticks, joints, _centres(joints, names), strict=True):
        for foot in robot.profile.feet.values():
            outline = np.array(foot.polygon)
            corners = np.column_stack([outline, np.zeros(len(outline))])
            link = robot.frame(foot.frame)
            local = link.position + corners
            q = np.ascontiguousarray(sent.q[tick : tick + 1])
            sole = robot.body.solver_body().points(q, [link.body] * len(local), local)[0] - middle
            across, up = _project(sole)
            axes.fill(across, up, facecolor="#dddddd", edgecolor="#999999", linewidth=0.6)
        _skeleton(axes, points - middle, names, bones)
        _frame_picture(axes, size)


def _skeleton(
    axes: Axes,
    points: FloatArray,
    names: tuple[str, ...],
    bones: Iterable[tuple[str, str]],
    *,
    colour: str | None = None,
) -> None:
    """Bones as lines, and the head as a dot; `colour` None: by side."""
    across, up = _project(points)
    for start, end in bones:
        ends = [names.index(start), names.index(end)]
        shade = colour or side_colour(end if end[:2] in ("l_", "r_") else start)
        axes.plot(across[ends], up[ends], color=shade, linewidth=1.2 if colour else 2.4, solid_capstyle="round")
    if "head" in names and colour is None:
        head = names.index("head")
        axes.plot(across[head], up[head], "o", color=MIDDLE, markersize=9)


def _project(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Across and up in the picture, m, of points (k, 3): parallel projection."""
    # The viewer stands at AZIMUTH from the x axis; across is to the viewer's right.
    across = -np.sin(AZIMUTH) * points[:, 0] + np.cos(AZIMUTH) * points[:, 1]
    nearer = np.cos(AZIMUTH) * points[:, 0] + np.sin(AZIMUTH) * points[:, 1]
    return across, points[:, 2] * np.cos(ELEVATION) - nearer * np.sin(ELEVATION)


def _centres(joints: FloatArray, names: tuple[str, ...]) -> FloatArray:
    """Where to centre each picture (p, 3): between the feet on the ground."""
    feet = [names.index(name) for name in ("l_ankle", "r_ankle") if name in names] or [0]
    centre = np.nanmean(joints[:, feet], axis=1)
    centre[:, 2] = 0.0
    return np.asarray(centre)


def _frame_picture(axes: Axes, height: float) -> None:
    """The same scale for all pictures of a line, the ground as a line, nothing else."""
    axes.axhline(0.0, color="#bbbbbb", linewidth=0.8, zorder=0)
    axes.set_xlim(-0.52 * height, 0.52 * height)
    axes.set_ylim(-0.14 * height, 1.08 * height)
    axes.set_aspect("equal")
    axes.set_axis_off()
