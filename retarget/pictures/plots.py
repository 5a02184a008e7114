"""`--plots DIR`: figures of a run, drawn with Matplotlib."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from retarget.errors import UsageError
from retarget.ik.support_polygon import convex_hull
from retarget.model.meshes import MIDDLE, SIDES
from retarget.pictures.solid import SHARPER, feet_of, performer_postures, robot_postures
from retarget.report import motion_metrics
from retarget.report.likeness import ARMS, LEAN, limb_angles
from retarget.report.measure import travel
from retarget.report.motion_metrics import moved_joints
from retarget.report.tracking import performer_facing, reference_of, turned
from retarget.run.run_result import RunResult
from retarget.schema.files import make_folder
from retarget.types import MM, FloatArray

# Style of all figures: Okabe and Ito's palette, which colour-blind readers can distinguish.

DESIRED = "#7a7a7a"
REACHED = "#0072b2"
SERVOS = "#e69f00"
LIMIT = "#cc79a7"
WARNING = "#d55e00"
DPI = 130
MOST_POINTS = 2500
"""Points of a line, at most about."""


def new_figure(width: float, height: float, title: str) -> Figure:
    """A figure of this size, inches, with automatic layout and one title."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=12, x=0.01, ha="left")
    return figure


def plain(axes: Axes) -> None:
    """Give axes a light grid and no box."""
    axes.grid(visible=True, color="#e6e6e6", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8, length=2)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def side_colour(name: str) -> str:
    """Colour of a body part: left, right, or middle."""
    return SIDES.get(name[:2], MIDDLE)


def thinned(rows: int) -> NDArray[Any]:
    """Return evenly spaced row numbers, about MOST_POINTS of them."""
    return np.arange(0, rows, max(1, rows // MOST_POINTS))


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG. Raises OSError."""
    figure.savefig(path, dpi=DPI, facecolor="white")


# A strip of poses: the reconstructed performer, and below it the robot at the same instants, in the same direction.

POSES = 9
"""Poses in a strip. With a robot, one of them is `least_alike`."""
WIDTH, MOST_PER_HEIGHT, TITLE, LABEL = 13.5, 1.7, 0.45, 0.36
"""Inches: width of the picture, greatest height of a body, height of the title, and of two lines over a pose."""
GAP = 0.07
"""Room between poses and between their lines, in heights of the head."""
TRAVELS = 0.5
"""Excess travel of the performer for a note in the title, m."""


def plot_poses(run: RunResult) -> Figure | None:
    """Draw the human above the robot, or the recorded body over the reconstructed one for a human alone."""
    if run.ticks_followed < 2:
        return None
    ticks, worst = unlike_ticks(run, min(POSES, run.ticks_followed)), least_alike(run)
    bodies = [performer_postures(run, ticks)]
    bodies += [] if run.robot is None else [robot_postures(run, ticks)]
    extents = np.array([[body.extent(pose) for pose in range(len(ticks))] for body in bodies])  # (lines, poses, 4)
    left, right = extents[..., 0].min(axis=0), extents[..., 1].max(axis=0)
    ends = np.cumsum(right - left + GAP)
    places = ends - right
    shadows = [place + body.shadow_end(pose) for body in bodies for pose, place in enumerate(places.tolist())]
    across = max(float(ends[-1]), *shadows)
    inches = min(WIDTH / across, MOST_PER_HEIGHT)
    lines = extents[..., 3].max(axis=1) - extents[..., 2].min(axis=1) + GAP
    lines[0] += LABEL / inches
    floors = np.cumsum(lines) + extents[..., 2].min(axis=1)
    down = float(lines.sum())
    scale = SHARPER * DPI * inches
    picture = Image.new("RGB", (round(scale * across), round(scale * down)), "white")
    for body, floor in zip(bodies, (scale * floors).tolist(), strict=True):
        for pose, place in enumerate((scale * places).tolist()):
            body.draw(picture, pose, place=(place, floor), scale=scale)
    title = "A performer, reconstructed (left orange, right blue)"
    if run.robot is not None:
        title = f"A performer, and {run.robot.profile.name} following (left orange, right blue)"
        gone = travel(run)[0]
        if gone.performer is not None and gone.robot is not None and gone.performer > TRAVELS + gone.robot:
            title += f"\nThe performer travels {gone.performer:.1f} m, the robot {gone.robot:.1f} m: not shown"
    elif run.human_truth is not None:
        title += "; thin: as recorded"
    figure = new_figure(max(inches * across, 6.0), inches * down + TITLE * (1 + title.count("\n")), title)
    axes = figure.subplots()
    axes.imshow(picture, extent=(0.0, across, down, 0.0), interpolation="antialiased")
    for place, tick in zip(places.tolist(), ticks, strict=True):
        label = f"{run.record.time[tick]:.1f} s" + ("\nleast alike" if tick == worst else "")
        axes.text(place, 0.0, label, fontsize=9, ha="center", va="top", color="#555555")
    axes.set_axis_off()
    return figure


def unlike_ticks(run: RunResult, count: int) -> list[int]:
    """Return `count` ticks at which the performer's postures differ most.

    They are the first tick that followed, `least_alike`, then the ticks of farthest point sampling, at least half an
    equal step apart. Equal steps could show a periodic motion in one phase only.
    """
    following, facing = run.record.following, performer_facing(run)
    points = turned(run.record.human_joints[following], facing)
    rows, worst = thinned(len(points)), least_alike(run)
    if worst is not None:
        rows = np.union1d(rows, worst - following.start)
    points = points[rows] - feet_of(points, run.record.human_joint_names)[rows]
    distance, room = np.full(len(points), np.inf), 0.5 * len(rows) / count
    number = np.arange(len(rows))
    chosen: list[int] = []

    def choose(row: int) -> None:
        chosen.append(row)
        distance[:] = np.minimum(distance, np.linalg.norm(points - points[row], axis=-1).sum(axis=-1))
        distance[np.abs(number - row) < room] = -1.0

    if worst is not None:
        choose(int(np.searchsorted(rows, worst - following.start)))
    if distance[0] >= 0.0:
        choose(0)
    while len(chosen) < count:
        choose(int(np.nanargmax(distance)))
    return sorted(following.start + int(rows[row]) for row in chosen)


def least_alike(run: RunResult) -> int | None:
    """The tick with the largest sum of angles between arms and trunk of robot and performer; None if none is
    known."""
    reference, q, following = reference_of(run), run.seen_q, run.record.following
    if run.robot is None or q is None or reference is None:
        return None
    limbs = limb_angles(run.robot, q, reference).items()
    angles = [angle[following] for limb, angle in limbs if limb in (*ARMS, LEAN)]
    off = np.concatenate(angles, axis=1).sum(axis=1) if angles else np.zeros(0)
    return following.start + int(np.nanargmax(off)) if np.isfinite(off).any() else None


# Every joint angle over time, and its limits.

_COLUMNS = 4
"""Panels in a line that are legible on a page."""


def plot_angles(run: RunResult) -> Figure | None:
    """Draw a panel for each joint: the sent angle, degrees, and its limits."""
    moved = moved_joints(run)

    def family(index: int) -> tuple[bool, str, bool]:
        """Sort paired joints first, by name, left before right."""
        name = moved.names[index]
        paired = name[:2] in SIDES
        return not paired, name[2:] if paired else name, name.startswith("r_")

    order = sorted(range(len(moved.names)), key=family)
    names, angles = tuple(moved.names[index] for index in order), np.rad2deg(moved.positions[:, order])
    lower, upper = np.rad2deg(moved.limits.lower[order]), np.rad2deg(moved.limits.upper[order])
    if not names or len(run.record) < 2:
        return None
    lines = math.ceil(len(names) / _COLUMNS)
    what = "human" if run.robot is None else run.robot.profile.name
    title = f"{what}: joint angles [deg]; shaded: beyond the limit"
    figure = new_figure(12.0, 1.35 * lines + 0.9, title)
    grid = figure.subplots(lines, _COLUMNS, sharex=True, squeeze=False)
    rows = thinned(len(run.record))
    for index, axes in enumerate(grid.ravel()):
        if index >= len(names):
            axes.set_visible(False)
            continue
        axes.plot(run.record.time[rows], angles[rows, index], color=side_colour(names[index]), linewidth=1.0)
        low = min(float(np.nanmin(angles[:, index])), lower[index])
        high = max(float(np.nanmax(angles[:, index])), upper[index])
        low, high = low - 0.06 * (high - low), high + 0.06 * (high - low)
        axes.axhspan(low - 999.0, lower[index], color=LIMIT, alpha=0.25, linewidth=0)
        axes.axhspan(upper[index], high + 999.0, color=LIMIT, alpha=0.25, linewidth=0)
        axes.set_ylim(low, high)
        axes.set_title(names[index].replace("_", " "), fontsize=9, loc="left", pad=3)
        plain(axes)
    for column in range(_COLUMNS):
        last = max((line for line in range(lines) if line * _COLUMNS + column < len(names)), default=0)
        grid[last, column].set_xlabel("time [s]", fontsize=9)
        grid[last, column].tick_params(labelbottom=True)
    return figure


# The centre of mass over the support polygon: from above, and its margin over time.


def plot_balance(run: RunResult) -> Figure | None:
    """Draw the path of the centre of mass over the soles, and its margin to the edge of the support polygon. Returns
    None for a body that does not stand."""
    robot, sent = run.robot, run.record.robot
    if robot is None or sent is None or len(run.record) < 2 or not robot.stands:
        return None
    stand = motion_metrics.standing_of(robot, sent.q)
    planned = "" if run.physics is None else ", as planned"
    figure, above, time = _over_soles(f"{robot.profile.name}: centre of mass over the support polygon{planned}")
    _outlines(above, stand.footprints(), "support polygon")
    rows, com, outside = thinned(len(stand.com)), MM * stand.com, stand.margin < -motion_metrics.OUTSIDE_M
    above.plot(com[rows, 1], com[rows, 0], color=REACHED, linewidth=0.9, label="centre of mass")
    if outside.any():
        above.plot(com[outside, 1], com[outside, 0], ".", color=WARNING, markersize=4, label="outside")
    _finish_above(above)
    margin = MM * stand.margin
    time.plot(run.record.time[rows], margin[rows], color=REACHED, linewidth=1.0)
    known = margin[np.isfinite(margin)]
    low = min(0.0, float(known.min())) if known.size else 0.0
    high = float(known.max()) if known.size else 1.0
    time.set_ylim(low - 0.08 * (high - low), high + 0.08 * (high - low))
    nearest = f"never nearer to the edge than {known.min():.1f} mm" if known.size else "in the air"
    _finish_margin(time, float(run.record.time[0]), nearest)
    return figure


def plot_pressure(run: RunResult) -> Figure | None:
    """Draw the paths of the centres of pressure and mass over the soles until a fall, and the distance of the former
    from the edge of the loaded soles, with gaps if none is loaded or a hand holds the robot. Returns None without
    physics, or if no sole was loaded."""
    robot, physics, sent = run.robot, run.physics, run.record.robot
    if robot is None or physics is None or sent is None or physics.least_margin is None or not robot.stands:
        return None
    figure, above, time = _over_soles(f"{robot.profile.name} in physics: centre of pressure under the soles")
    _outlines(above, motion_metrics.standing_of(robot, sent.q).footprints(), "hull of both")
    fall = physics.fall
    stands = physics.time <= (np.inf if fall is None else fall.time)
    rows = thinned(int(np.count_nonzero(stands)))
    pressure, com = MM * physics.pressure[rows], MM * physics.com[rows]
    above.plot(pressure[:, 1], pressure[:, 0], color=REACHED, linewidth=0.7, label="pressure")
    above.plot(com[:, 1], com[:, 0], color="black", linewidth=0.9, label="centre of mass")
    _finish_above(above)
    rows = thinned(len(physics.time))
    time.plot(physics.time[rows], MM * physics.margin[rows], color=REACHED, linewidth=0.8)
    if fall is not None:
        time.axvline(fall.time, color=WARNING, linewidth=1.0, linestyle="--")
        where = (fall.time, time.get_ylim()[1])
        time.annotate("fallen ", where, ha="right", va="top", fontsize=8, color=WARNING)
    # In each step of a walk the pressure ends on an edge.
    walked = run.tally.walk is not None and run.tally.walk.steps > 0
    nearest = "" if walked else f"never nearer to the edge than {MM * physics.least_margin:z.1f} mm"
    _finish_margin(time, float(physics.time[0]), nearest)
    return figure


BOTH = 2
"""Footprints of a robot that made no step."""


def _over_soles(title: str) -> tuple[Figure, Axes, Axes]:
    figure = new_figure(11.0, 4.6, title)
    above, time = figure.subplots(1, 2, width_ratios=(1.0, 1.35))
    return figure, above, time


def _outlines(axes: Axes, footprints: Sequence[FloatArray], hull_label: str) -> None:
    """Draw footprints (c, 3), m, and their hull if the robot made no step. Forward is up, left is left."""
    soles = [MM * sole for sole in footprints]
    for sole in soles:
        label = "soles" if sole is soles[0] else None
        axes.fill(sole[:, 1], sole[:, 0], facecolor="#dddddd", edgecolor="#999999", linewidth=0.8, label=label)
    if len(soles) > BOTH:
        return
    hull = convex_hull(np.concatenate(soles)[:, :2])
    closed = np.vstack([hull, hull[:1]])
    axes.plot(closed[:, 1], closed[:, 0], color=MIDDLE, linewidth=1.0, linestyle="--", label=hull_label)


def _finish_above(axes: Axes) -> None:
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_xaxis()  # left is left, and positive
    axes.set_xlabel("left [mm]", fontsize=9)
    axes.set_ylabel("forward [mm]", fontsize=9)
    axes.set_title("from above", fontsize=10, loc="left")
    plain(axes)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=3, frameon=False, fontsize=9)


def _finish_margin(axes: Axes, start: float, title: str) -> None:
    axes.axhline(0.0, color=WARNING, linewidth=1.2)
    axes.annotate("edge", (start, 0.0), xytext=(2, 3), textcoords="offset points", fontsize=8, color=WARNING)
    axes.set_xlabel("time [s]", fontsize=9)
    axes.set_ylabel("distance inside the edge [mm]", fontsize=9)
    axes.set_title(title, fontsize=10, loc="left")
    plain(axes)


# Landmarks (for a human alone, sensors) over time: desired, as sent, and as reached by the servos.

_SHOWN = ("l_hand", "l_wrist", "r_hand", "r_wrist", "head", "pelvis", "l_ankle", "r_ankle")
"""Landmarks and sensors that are shown, in this order."""
_LEAST_M = 0.05
"""Smallest range of an axis, m, so that noise looks small."""
_SEEN_MM = 0.1
"""Error below which its panel is left out, mm."""


@dataclass(frozen=True, eq=False)
class _Track:
    label: str
    colour: str
    width: float
    positions: FloatArray


def plot_tracking(run: RunResult) -> Figure | None:
    """Draw a column for each of the landmarks in _SHOWN: x, y, z, and the distance from its desired place."""
    names, desired, reached = run.followed
    known = np.flatnonzero(np.count_nonzero(np.isfinite(desired[..., 0]), axis=0)).tolist()
    shown = [name for name in _SHOWN if name in names and names.index(name) in known]
    if not shown or len(run.record) < 2:
        return None
    columns = [names.index(name) for name in shown]
    tracks = _tracks(run, names, reached, columns)
    desired = desired[:, columns]
    errors = [1e3 * np.linalg.norm(track.positions - desired, axis=-1) for track in tracks]
    most = max(float(np.nanmax(error)) for error in errors)
    lines = 4 if most >= _SEEN_MM else 3
    x, y, title = "x", "y", "human: sensors desired and reached"  # a recorded performer faces anywhere
    if run.robot is not None:
        servos = ", and where the servos stood" if len(tracks) > 1 else ""
        x, y, title = "x, forward", "y, left", f"{run.robot.profile.name}: desired and sent{servos}, lag included"
    elif lines < 4:
        title += f", less than {_SEEN_MM:g} mm apart"
    figure = new_figure(3.1 * len(shown) + 0.6, 1.9 * lines + 0.5, title)
    grid = figure.subplots(lines, len(shown), sharex=True, squeeze=False)
    time, rows = run.record.time, thinned(len(run.record))
    for column, name in enumerate(shown):
        for axis in range(3):
            axes = grid[axis, column]
            line = desired[rows, column, axis]
            axes.plot(time[rows], line, color=DESIRED, linewidth=2.2, alpha=0.6, label="desired")
            for track in tracks:
                line = track.positions[rows, column, axis]
                axes.plot(time[rows], line, color=track.colour, linewidth=track.width, label=track.label)
            low, high = axes.get_ylim()
            room = max(_LEAST_M - (high - low), 0.0) / 2.0
            axes.set_ylim(low - room, high + room)
            plain(axes)
        if lines > 3:
            _show_errors(grid[3, column], time, tracks, [error[:, column] for error in errors])
        grid[-1, column].set_xlabel("time [s]", fontsize=9)
        grid[0, column].set_title(name.replace("_", " "), fontsize=11)
    for axes, label in zip(grid[:, 0], (f"{x} [m]", f"{y} [m]", "z, up [m]", "error [mm]"), strict=False):
        axes.set_ylabel(label, fontsize=9)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=3, frameon=False, fontsize=9)
    return figure


def _tracks(run: RunResult, names: tuple[str, ...], reached: FloatArray, columns: list[int]) -> list[_Track]:
    if run.robot is None:
        return [_Track("reached", REACHED, 1.0, reached[:, columns])]
    tracks = [_Track("sent", REACHED, 1.8, reached[:, columns])]
    stood = run.present_q(slice(None))
    if stood is not None:
        frames = run.robot.landmark_frames(tuple(names[column] for column in columns))
        tracks.append(_Track("servos", SERVOS, 0.8, run.robot.points(stood, frames)))
    return tracks


def _show_errors(axes: Axes, time: FloatArray, tracks: list[_Track], errors: list[FloatArray]) -> None:
    rows = thinned(len(time))
    for line, (track, error) in enumerate(zip(tracks, errors, strict=True)):
        axes.plot(time[rows], error[rows], color=track.colour, linewidth=track.width)
        known = error[np.isfinite(error)]
        text = f"{track.label}: mean {known.mean():.1f} mm, most {known.max():.1f} mm" if known.size else ""
        axes.annotate(
            text,
            (0.0, 1.0),
            xytext=(0, 4 + 11 * (len(tracks) - 1 - line)),
            xycoords="axes fraction",
            textcoords="offset points",
            fontsize=8.5,
            color=track.colour,
        )
    axes.set_ylim(0.0, max(axes.get_ylim()[1], 1.0))
    plain(axes)


PICTURES = {
    "tracking": plot_tracking,
    "angles": plot_angles,
    "balance": plot_balance,
    "pressure": plot_pressure,
    "poses": plot_poses,
}
"""File name without suffix -> function that draws the figure, or returns None."""


def figures_of(run: RunResult) -> dict[str, Figure]:
    """Draw every figure that has something to show, by name."""
    with matplotlib.rc_context({"text.parse_math": False}):  # a name with dollar signs is a name, not a formula
        drawn = {name: draw(run) for name, draw in PICTURES.items()}
    return {name: figure for name, figure in drawn.items() if figure is not None}


def write_plots(figures: Mapping[str, Figure], folder: Path) -> list[Path]:
    """Write figures as PNG files into `folder`. Raises UsageError."""
    written = []
    make_folder(folder, option="--plots")
    try:
        for name, figure in figures.items():
            path = folder / f"{name}.png"
            save_figure(figure, path)
            written.append(path)
    except OSError as error:
        raise UsageError("cannot write pictures", where="--plots", found=f"{folder}: {error.strerror}") from error
    return written
