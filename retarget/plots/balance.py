"""The centre of mass over the support polygon: from above, and how far inside it stayed over time."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from retarget.metrics import standing
from retarget.plots.style import MIDDLE, REACHED, WARNING, new_figure, plain, thinned
from retarget.rotations import FloatArray
from retarget.run_result import RunResult
from retarget.support import convex_hull

__all__ = ["plot_balance"]

MM = 1e3


def plot_balance(run: RunResult) -> Figure | None:
    """Path of the centre of mass over the soles, and its distance from the edge of the support polygon.

    None for a body that does not stand on its own feet.
    """
    robot, sent = run.robot, run.record.robot
    if robot is None or sent is None or len(run.record) < 2 or not robot.stands:
        return None
    soles = standing.soles_of(robot, sent.q)
    corners = np.concatenate([standing.sole_corners(sole) for sole in soles], axis=1)
    com = robot.body.solver_body().centre_of_mass(np.ascontiguousarray(sent.q))
    margin = standing.support_margin(com, corners)
    figure = new_figure(11.0, 4.6, f"{robot.profile.name}: centre of mass over the support polygon")
    above, time = figure.subplots(1, 2, width_ratios=(1.0, 1.35))
    _from_above(above, com, corners, margin, len(robot.profile.feet))
    _over_time(time, run.record.time, margin)
    return figure


def _from_above(axes: Axes, com: FloatArray, corners: FloatArray, margin: FloatArray, feet: int) -> None:
    """Soles where they were first, their hull, and the path of the centre of mass; forward is up, left is left."""
    first = MM * corners[0]
    for foot in np.split(first, feet):
        axes.fill(-foot[:, 1], foot[:, 0], facecolor="#dddddd", edgecolor="#999999", linewidth=0.8)
    hull = convex_hull(first[:, :2])
    closed = np.vstack([hull, hull[:1]])
    axes.plot(-closed[:, 1], closed[:, 0], color=MIDDLE, linewidth=1.0, linestyle="--", label="support polygon")
    rows = thinned(len(com))
    axes.plot(-MM * com[rows, 1], MM * com[rows, 0], color=REACHED, linewidth=0.9, label="centre of mass")
    outside = margin < -standing.OUTSIDE_M
    if outside.any():
        axes.plot(-MM * com[outside, 1], MM * com[outside, 0], ".", color=WARNING, markersize=4, label="outside")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("left  -  right [mm]", fontsize=9)
    axes.set_ylabel("forward [mm]", fontsize=9)
    axes.set_title("from above", fontsize=10, loc="left")
    plain(axes)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=3, frameon=False, fontsize=9)


def _over_time(axes: Axes, time: FloatArray, margin: FloatArray) -> None:
    """Distance from the edge, mm; below 0 it would fall."""
    rows = thinned(len(time))
    axes.plot(time[rows], MM * margin[rows], color=REACHED, linewidth=1.0)
    axes.axhline(0.0, color=WARNING, linewidth=1.2)
    known = MM * margin[np.isfinite(margin)]
    low = min(0.0, float(known.min())) if known.size else 0.0
    high = float(known.max()) if known.size else 1.0
    axes.set_ylim(low - 0.08 * (high - low), high + 0.08 * (high - low))
    axes.annotate("edge", (time[0], 0.0), xytext=(2, 3), textcoords="offset points", fontsize=8, color=WARNING)
    axes.set_xlabel("time [s]", fontsize=9)
    axes.set_ylabel("distance inside the edge [mm]", fontsize=9)
    nearest = f"never nearer to the edge than {known.min():.1f} mm" if known.size else "in the air"
    axes.set_title(nearest, fontsize=10, loc="left")
    plain(axes)
