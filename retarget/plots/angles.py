"""Every joint angle over time, and its limits."""

import math

import numpy as np
from matplotlib.figure import Figure

from retarget.plots.style import LIMIT, new_figure, plain, side_colour, thinned
from retarget.rotations import FloatArray
from retarget.run_result import RunResult

__all__ = ["plot_angles"]

_COLUMNS = 4


def plot_angles(run: RunResult) -> Figure | None:
    """A panel for each joint: the angle that was sent, in degrees, between its limits."""
    names, angles, lower, upper = (_of_robot if run.robot is not None else _of_human)(run)
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
        low, high = _window(angles[:, index], lower[index], upper[index])
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


def _window(angle: FloatArray, lower: float, upper: float) -> tuple[float, float]:
    """Range to show: both limits, and the curve where it is beyond them."""
    low, high = min(float(np.nanmin(angle)), lower), max(float(np.nanmax(angle)), upper)
    room = 0.06 * (high - low)
    return low - room, high + room


def _of_robot(run: RunResult) -> tuple[tuple[str, ...], FloatArray, FloatArray, FloatArray]:
    """Names, angles (T, n), lower and upper limits (n,), degrees, left and right side by side."""
    robot, sent = run.robot, run.record.robot
    assert robot is not None and sent is not None
    joints = robot.joint_map.joints
    order = sorted(range(len(joints)), key=lambda index: _family(joints[index]))
    angles = np.rad2deg(sent.q[:, robot.servo_columns])[:, order]
    lower, upper = np.rad2deg(robot.joint_map.lower)[order], np.rad2deg(robot.joint_map.upper)[order]
    return tuple(joints[index] for index in order), angles, lower, upper


def _of_human(run: RunResult) -> tuple[tuple[str, ...], FloatArray, FloatArray, FloatArray]:
    """As of a robot, for the hinges of the human that are free to move."""
    body = run.human.body
    single, address = body.scalar_joints()
    shown = np.flatnonzero(single & ~run.human.locked)
    names = tuple(body.dof_names[dof] for dof in shown)
    order = sorted(range(len(names)), key=lambda index: _family(names[index]))
    dofs = shown[order]
    angles = np.rad2deg(run.record.human.q[:, address[dofs]])
    return tuple(names[index] for index in order), angles, np.rad2deg(body.lower[dofs]), np.rad2deg(body.upper[dofs])


def _family(joint: str) -> tuple[bool, str, bool]:
    """Paired joints first, by what they are, left before right."""
    paired = joint[:2] in ("l_", "r_")
    return (not paired, joint[2:] if paired else joint, joint.startswith("r_"))
