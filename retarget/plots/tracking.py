"""Where landmarks (of a human: sensors) were asked to be, were sent and were reached by the servos, over time."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from retarget.plots.style import ASKED, REACHED, SERVOS, new_figure, plain, thinned
from retarget.rotations import FloatArray
from retarget.run_result import RunResult

__all__ = ["plot_tracking"]

_SHOWN = ("l_hand", "l_wrist", "r_hand", "r_wrist", "head", "pelvis", "l_ankle", "r_ankle")
"""What is shown, in this order, where it was asked at all."""
_LEAST_M = 0.05
_SEEN_MM = 0.1
"""Where every error is smaller than this, no panel shows it."""


@dataclass(frozen=True, eq=False)
class _Track:
    """Positions (T, k, 3) m of what is shown, and how they are drawn."""

    label: str
    colour: str
    width: float
    positions: FloatArray


def plot_tracking(run: RunResult) -> Figure | None:
    """One column for each of the most telling landmarks: x, y, z, and the distance from where it was asked."""
    names, asked, reached = run.followed
    known = np.flatnonzero(np.count_nonzero(np.isfinite(asked[..., 0]), axis=0)).tolist()
    shown = [name for name in _SHOWN if name in names and names.index(name) in known]
    if not shown or len(run.record) < 2:
        return None
    columns = [names.index(name) for name in shown]
    tracks = _tracks(run, names, reached, columns)
    asked = asked[:, columns]
    errors = [1e3 * np.linalg.norm(track.positions - asked, axis=-1) for track in tracks]
    most = max(float(np.nanmax(error)) for error in errors)
    lines = 4 if most >= _SEEN_MM else 3
    figure = new_figure(3.1 * len(shown) + 0.6, 1.9 * lines + 0.5, _title(run, tracks, most))
    grid = figure.subplots(lines, len(shown), sharex=True, squeeze=False)
    time, rows = run.record.time, thinned(len(run.record))
    for column, name in enumerate(shown):
        for axis in range(3):
            axes = grid[axis, column]
            axes.plot(time[rows], asked[rows, column, axis], color=ASKED, linewidth=2.2, alpha=0.6, label="asked")
            for track in tracks:
                line = track.positions[rows, column, axis]
                axes.plot(time[rows], line, color=track.colour, linewidth=track.width, label=track.label)
            _widen(axes)
            plain(axes)
        if lines > 3:
            _show_errors(grid[3, column], time, tracks, [error[:, column] for error in errors])
        grid[-1, column].set_xlabel("time [s]", fontsize=9)
        grid[0, column].set_title(name.replace("_", " "), fontsize=11)
    for axes, label in zip(grid[:, 0], _labels(run), strict=False):
        axes.set_ylabel(label, fontsize=9)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=3, frameon=False, fontsize=9)
    return figure


def _tracks(run: RunResult, names: tuple[str, ...], reached: FloatArray, columns: list[int]) -> list[_Track]:
    """Of a robot what was sent and, with servos that answer, where they stood; of a human what was reached."""
    if run.robot is None:
        return [_Track("reached", REACHED, 1.0, reached[:, columns])]
    tracks = [_Track("sent", REACHED, 1.8, reached[:, columns])]
    stood = run.present_q
    if stood is not None:
        frames = run.robot.landmark_frames(tuple(names[column] for column in columns))
        tracks.append(_Track("servos", SERVOS, 0.8, run.robot.points(stood, frames)))
    return tracks


def _title(run: RunResult, tracks: list[_Track], most: float) -> str:
    if run.robot is None:
        return "human: sensors asked and reached" + ("" if most >= _SEEN_MM else f", less than {_SEEN_MM:g} mm apart")
    servos = ", and where the servos stood" if len(tracks) > 1 else ""
    return f"{run.robot.profile.name}: asked and sent{servos}, lag included"


def _labels(run: RunResult) -> tuple[str, ...]:
    """A robot faces x; a recorded performer faces anywhere."""
    x, y = ("x", "y") if run.robot is None else ("x, forward", "y, left")
    return f"{x} [m]", f"{y} [m]", "z, up [m]", "error [mm]"


def _show_errors(axes: Axes, time: FloatArray, tracks: list[_Track], errors: list[FloatArray]) -> None:
    """Distances (T,) mm of one landmark from where it was asked, and above them their mean and largest."""
    rows = thinned(len(time))
    for line, (track, error) in enumerate(zip(tracks, errors, strict=True)):
        axes.plot(time[rows], error[rows], color=track.colour, linewidth=track.width)
        known = error[np.isfinite(error)]
        said = f"{track.label}: mean {known.mean():.1f} mm, most {known.max():.1f} mm" if known.size else ""
        axes.annotate(
            said,
            (0.0, 1.0),
            xytext=(0, 4 + 11 * (len(tracks) - 1 - line)),
            xycoords="axes fraction",
            textcoords="offset points",
            fontsize=8.5,
            color=track.colour,
        )
    axes.set_ylim(0.0, max(axes.get_ylim()[1], 1.0))
    plain(axes)


def _widen(axes: Axes) -> None:
    """Show at least `_LEAST_M`, so that standing still looks like it."""
    low, high = axes.get_ylim()
    room = max(_LEAST_M - (high - low), 0.0) / 2.0
    axes.set_ylim(low - room, high + room)
