"""The centre of pressure of a simulated robot: from above, and how far inside the soles that carried it was."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from retarget.physics_run import PhysicsRun
from retarget.plots.style import MIDDLE, REACHED, WARNING, new_figure, plain, thinned
from retarget.robot_body import RobotBody
from retarget.run_result import RunResult
from retarget.stance import plant
from retarget.support import convex_hull

__all__ = ["plot_pressure"]

MM = 1e3


def plot_pressure(run: RunResult) -> Figure | None:
    """Path of the centre of pressure and of the centre of mass over the soles, and the distance of the former from the
    edge of the soles that carried. None without physics, or where no sole carried."""
    robot, physics = run.robot, run.physics
    if robot is None or physics is None or physics.least_margin is None or not robot.stands:
        return None
    figure = new_figure(11.0, 4.6, f"{robot.profile.name} in physics: centre of pressure under the soles")
    above, time = figure.subplots(1, 2, width_ratios=(1.0, 1.35))
    _from_above(above, robot, physics)
    _over_time(time, physics)
    return figure


def _from_above(axes: Axes, robot: RobotBody, physics: PhysicsRun) -> None:
    """Soles where they began, their hull, and both paths until a fall; forward is up, left is left."""
    outlines = [MM * sole.outline for sole in plant(robot, robot.profile.postures.stand).soles]
    for outline in outlines:
        axes.fill(-outline[:, 1], outline[:, 0], facecolor="#dddddd", edgecolor="#999999", linewidth=0.8)
    hull = convex_hull(np.concatenate(outlines))
    closed = np.vstack([hull, hull[:1]])
    axes.plot(-closed[:, 1], closed[:, 0], color=MIDDLE, linewidth=1.0, linestyle="--", label="both soles")
    stands = physics.time <= (np.inf if physics.fall is None else physics.fall.time)
    rows = thinned(int(np.count_nonzero(stands)))
    pressure, com = MM * physics.pressure[rows], MM * physics.com[rows]
    axes.plot(-pressure[:, 1], pressure[:, 0], color=REACHED, linewidth=0.7, label="pressure")
    axes.plot(-com[:, 1], com[:, 0], color="black", linewidth=0.9, label="centre of mass")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("left  -  right [mm]", fontsize=9)
    axes.set_ylabel("forward [mm]", fontsize=9)
    axes.set_title("from above", fontsize=10, loc="left")
    plain(axes)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=3, frameon=False, fontsize=9)


def _over_time(axes: Axes, physics: PhysicsRun) -> None:
    """Distance from the edge, mm; at 0 the soles begin to tip. A gap: no sole carried, or a hand held the robot."""
    rows = thinned(len(physics.time))
    axes.plot(physics.time[rows], MM * physics.margin[rows], color=REACHED, linewidth=0.8)
    axes.axhline(0.0, color=WARNING, linewidth=1.2)
    axes.annotate("edge", (physics.time[0], 0.0), xytext=(2, 3), textcoords="offset points", fontsize=8, color=WARNING)
    fall = physics.fall
    if fall is not None:
        axes.axvline(fall.time, color=WARNING, linewidth=1.0, linestyle="--")
        where = (fall.time, axes.get_ylim()[1])
        axes.annotate("fallen ", where, ha="right", va="top", fontsize=8, color=WARNING)
    axes.set_xlabel("time [s]", fontsize=9)
    axes.set_ylabel("distance inside the edge [mm]", fontsize=9)
    axes.set_title(
        f"never nearer to the edge than {MM * (physics.least_margin or 0.0):z.1f} mm", fontsize=10, loc="left"
    )
    plain(axes)
