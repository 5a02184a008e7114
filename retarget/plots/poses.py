"""A strip of poses: the performer as reconstructed, and the robot below, at the same instants, facing the same way."""

from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

from retarget.facing import Facing
from retarget.human_dimensions import PARENTS, POINTS
from retarget.human_posture import ORIENTED, PostureReader
from retarget.plots.skeleton import Bone, Skeleton, draw_skeleton, turned
from retarget.plots.style import new_figure
from retarget.rotations import FloatArray
from retarget.run_result import RunResult

__all__ = ["ROBOT_BONES", "performer_facing", "plot_poses", "telling_ticks"]

POSES = 9
WIDTH, MOST_PER_HEIGHT, TITLE = 13.5, 1.7, 0.45
"""Inches: of the whole picture, of a body's height at most, and of the title."""
GAP, ROOM = 0.07, 0.12
"""Between poses and above each line of them, in heights of the head."""
_PARENT = {name: POINTS[parent] for name, parent in zip(POINTS, PARENTS, strict=True) if parent >= 0}
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
    ticks = telling_ticks(run)
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
    names, joints = human.joint_names, human.joints[following]
    pelvis = PostureReader(run.human).orientations(np.ascontiguousarray(human.q[following]))[
        :, ORIENTED.index("pelvis")
    ]
    feet = [joints[:, names.index(f"{side}_toe")] - joints[:, names.index(f"{side}_ankle")] for side in "lr"]
    facing, rows = Facing(), zip(pelvis.tolist(), *(foot.tolist() for foot in feet), strict=True)
    return np.array([facing.update(seen, left, right, run.clip.dt) for seen, left, right in rows]).reshape(-1, 2)


def telling_ticks(run: RunResult) -> list[int]:
    """Rows to show: of the parts of the clip in turn, where the performer differs most from the pose shown before.

    The first is where the hands are highest. None is nearer to the one before than half a part.
    """
    following = run.record.following
    names = run.record.human.joint_names
    joints = turned(run.record.human.joints[following], performer_facing(run))
    high = joints[:, [names.index("l_wrist"), names.index("r_wrist")], 2].max(axis=1)
    shape = joints - _feet(joints, names)
    edges = np.linspace(0, len(joints), min(POSES, len(joints)) + 1)
    gap = 0.5 * float(edges[1])
    shown: list[int] = []
    for start, end in pairwise(edges.astype(int)):
        first = max(int(start), int(np.ceil(shown[-1] + gap))) if shown else int(start)
        other = np.linalg.norm(shape[first:end] - shape[shown[-1]], axis=-1).mean(axis=-1) if shown else high[first:end]
        shown.append(first + int(np.argmax(other)))
    return [following.start + row for row in shown]


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
    bones = tuple((_PARENT[name], name) for name in names if _PARENT.get(name) in names)
    return Skeleton(names, bones, (points - feet) / size, recorded=recorded)


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
    bones = tuple((a, b) for a, b in ROBOT_BONES if a in names and b in names)
    return Skeleton(names, bones, (points - feet) / size, soles=tuple(soles))


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
