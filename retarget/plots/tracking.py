"""Where landmarks (of a human: sensors) were asked to be and where they were, over time."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from retarget.plots.style import ASKED, REACHED, new_figure, plain, thinned
from retarget.run_result import RunResult

__all__ = ["plot_tracking"]

_SHOWN = ("l_hand", "l_wrist", "r_hand", "r_wrist", "head", "pelvis", "l_ankle", "r_ankle")
"""What is shown, in this order, where it exists; four at most."""
_COLUMNS = 4
_LEAST_M = 0.05
_AXES = ("x, forward [m]", "y, left [m]", "z, up [m]")


def plot_tracking(run: RunResult) -> Figure | None:
    """One column for each of the most telling landmarks: x, y, z and the distance between asked and reached."""
    names, asked, reached = run.followed
    shown = [name for name in _SHOWN if name in names][:_COLUMNS]
    if not shown or len(run.record) < 2:
        return None
    rows = thinned(len(run.record))
    time = run.record.time[rows]
    what = "human" if run.robot is None else run.robot.profile.name
    figure = new_figure(3.1 * len(shown) + 0.6, 8.0, f"{what}: asked and reached, lag included")
    grid = figure.subplots(4, len(shown), sharex=True, squeeze=False)
    for column, name in enumerate(shown):
        index = names.index(name)
        for row in range(3):
            axes = grid[row, column]
            axes.plot(time, asked[rows, index, row], color=ASKED, linewidth=2.2, alpha=0.6, label="asked")
            axes.plot(time, reached[rows, index, row], color=REACHED, linewidth=1.0, label="reached")
            _widen(axes)
            plain(axes)
        error = 1e3 * np.linalg.norm(reached[:, index] - asked[:, index], axis=1)
        axes = grid[3, column]
        axes.fill_between(time, 0.0, error[rows], color=REACHED, alpha=0.25, linewidth=0)
        axes.plot(time, error[rows], color=REACHED, linewidth=0.8)
        axes.set_ylim(0.0, max(axes.get_ylim()[1], 1.0))
        axes.set_xlabel("time [s]", fontsize=9)
        plain(axes)
        known = error[np.isfinite(error)]
        mean = f"mean {known.mean():.1f} mm, most {known.max():.1f} mm" if known.size else "nothing asked"
        axes.set_title(mean, fontsize=9, color=REACHED, loc="left")
        grid[0, column].set_title(name.replace("_", " "), fontsize=11)
    for row, label in enumerate((*_AXES, "error [mm]")):
        grid[row, 0].set_ylabel(label, fontsize=9)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=2, frameon=False, fontsize=9)
    return figure


def _widen(axes: Axes) -> None:
    """Show at least `_LEAST_M`, so that standing still looks like it."""
    low, high = axes.get_ylim()
    room = max(_LEAST_M - (high - low), 0.0) / 2.0
    axes.set_ylim(low - room, high + room)
