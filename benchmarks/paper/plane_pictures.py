"""Pictures of what happens in a plane, after the paper's Figures 4, 5 and 6. Across is x, up is z."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from benchmarks.paper.chain_runs import DT, ChainRun
from benchmarks.paper.damping_law import BALL, DampedPoint
from benchmarks.paper.outlines import OBSTACLE, ZONE_SHARE
from benchmarks.paper.solver_rig import Ball
from retarget.pictures.plots import DESIRED, REACHED, WARNING, new_figure
from retarget.types import FloatArray

NEAR = "#e69f00"
"""Colour of links within influence that do not act."""
PANELS = 6
_PLANE = [0, 2]


def figure_4(points: list[DampedPoint]) -> Figure:
    """Displacements asked (grey) and left (blue)."""
    figure = new_figure(7.0, 5.6, "Damping in the influence of a sphere (the paper's Figure 4)")
    axes = figure.subplots()
    _ball(axes, BALL, np.array(BALL.centre))
    for point in points:
        x, z = point.position[_PLANE]
        _arrow(axes, point.position, point.asked, DESIRED, 2.0)
        _arrow(axes, point.position, point.got, REACHED, 3.0)
        axes.plot(x, z, "o", color="black", markersize=7, zorder=6)
        note = rf"{point.name}   $\alpha$ = {point.share:.2f}" if point.acted else f"{point.name}   unaltered"
        away, ha = ((-9, 7), "right") if point.name == "e4" else ((9, -13 if point.name == "e1" else 7), "left")
        axes.annotate(note, (x, z), away, textcoords="offset points", ha=ha, fontsize=10, zorder=7)
        if point.acted:
            foot = point.position - point.normal * (np.linalg.norm(point.position) - BALL.radius)
            axes.plot(*np.stack([point.position, foot])[:, _PLANE].T, ":", color="#00563f", linewidth=1.0, zorder=4)
    axes.plot([], [], color=DESIRED, linewidth=2.0, label="displacement asked")
    axes.plot([], [], color=REACHED, linewidth=3.0, label="displacement given by the solver")
    axes.legend(loc="lower right", frameon=False, fontsize=9)
    _frame(axes, (-1.30, 1.30), (-1.15, 1.20))
    return figure


def figure_5(run: ChainRun) -> Figure:
    """The sphere comes, the chain bends away."""
    figure = new_figure(13.0, 2.5, "A sphere moves against a still chain of 4 joints (the paper's Figure 5)")
    panels = figure.subplots(1, PANELS)
    first = int(np.argmax(run.within.any(axis=(1, 2)))) - 20
    for axes, k in zip(
        panels, np.linspace(first, len(run.points) - 1, PANELS).round().astype(int).tolist(), strict=True
    ):
        _moment(axes, run, k)
        velocity = np.array(run.balls[0].velocity)
        _arrow(axes, run.centres[k, 0], 0.5 * velocity, "#00563f", 1.6)
        _frame(axes, (-0.48, 0.36), (-0.03, 0.50))
        axes.set_title(f"{k * DT:.2f} s", fontsize=9, color="#555555")
    return figure


def figure_6(one: ChainRun, two: ChainRun) -> Figure:
    """Left: who acts. Right: the sequences."""
    figure = new_figure(13.0, 5.0, "A chain of 10 joints reaches for a low goal (the paper's Figure 6)")
    rows = figure.subplots(2, PANELS, gridspec_kw={"width_ratios": [1.0] * PANELS})
    labels = (
        "(a) one obstacle: of the links in its zone\n(orange) only the closest acts (red)",
        "(b) two obstacles: one link acts for each",
    )
    for panels, run, label in zip(rows, (one, two), labels, strict=True):
        telling = _telling(run)
        shown = [telling, *np.linspace(0, _arrival(run), PANELS - 1).round().astype(int).tolist()]
        for axes, k in zip(panels, shown, strict=True):
            _moment(axes, run, k)
            if run.goal is not None:
                axes.plot(*run.goal[_PLANE], "x", color="black", markersize=8, markeredgewidth=2.0, zorder=7)
            _frame(axes, (-0.30, 0.86), (-0.04, 1.04))
            axes.set_title(f"{k * DT:.2f} s", fontsize=9, color="#555555")
        panels[0].set_title("")
        panels[0].text(-0.30, 1.04, label, fontsize=8.5, va="top")
    return figure


def _moment(axes: Axes, run: ChainRun, k: int) -> None:
    """A chain at one frame: its links thick, by what they do."""
    for ball, centre in zip(run.balls, run.centres[k], strict=True):
        _ball(axes, ball, centre)
    points = run.points[k][:, _PLANE]
    for link in range(len(points) - 1):
        acts, near = run.modes[k, link] > 0, bool(run.within[k, link].any())
        colour = WARNING if acts else NEAR if near else REACHED
        axes.plot(*points[link : link + 2].T, color=colour, linewidth=6.0, solid_capstyle="round", zorder=4 + acts)
    axes.plot(*points.T, "o", color="white", markersize=3.5, zorder=6)
    axes.plot(*points[0], marker=(3, 0, 0), color="black", markersize=12, zorder=3)


def _telling(run: ChainRun) -> int:
    """The frame in which most links act, and of those that in which most are within influence."""
    acting, within = (run.modes > 0).sum(axis=1), run.within.any(axis=2).sum(axis=1)
    return int(np.argmax(100 * acting + within))


def _arrival(run: ChainRun) -> int:
    """The first frame at which the tip is at the goal; the last one if it never is."""
    assert run.goal is not None
    there = np.flatnonzero(np.linalg.norm(run.points[:, -1] - run.goal, axis=1) < 1e-3)
    return int(there[0]) if len(there) else len(run.points) - 1


def _ball(axes: Axes, ball: Ball, centre: FloatArray) -> None:
    x, z = centre[_PLANE]
    reach = ball.radius + ball.influence
    axes.add_patch(Circle((x, z), reach, facecolor=OBSTACLE, alpha=ZONE_SHARE, linewidth=0, zorder=1))
    axes.add_patch(
        Circle((x, z), reach, fill=False, edgecolor=OBSTACLE, linewidth=0.7, linestyle=(0, (4, 3)), zorder=1)
    )
    axes.add_patch(Circle((x, z), ball.radius, facecolor=OBSTACLE, edgecolor="#00563f", linewidth=0.8, zorder=2))


def _arrow(axes: Axes, start: FloatArray, way: FloatArray, colour: str, width: float) -> None:
    x, z = start[_PLANE]
    dx, dz = way[_PLANE]
    axes.annotate(
        "",
        (x + dx, z + dz),
        (x, z),
        arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": width, "shrinkA": 0, "shrinkB": 0},
        zorder=5,
    )


def _frame(axes: Axes, across: tuple[float, float], up: tuple[float, float]) -> None:
    axes.set_xlim(*across)
    axes.set_ylim(*up)
    axes.set_aspect("equal")
    axes.set_axis_off()
