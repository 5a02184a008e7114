"""Whether anything was taken from the highest level: errors of its tasks, measured on the postures that were sent."""

from collections.abc import Iterable

import numpy as np

from retarget import rotations
from retarget.metrics import standing, tracking
from retarget.priorities import AxisTask, CentreOfMassTask, OrientationTask, PositionTask, Priorities, Task
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from retarget.run_result import RunResult

__all__ = ["top_level_error", "top_tasks"]


LIFTED_M = 1e-4
"""A sole of a robot that steps is not locked to the floor when it is higher than this."""


def top_tasks(priorities: Priorities) -> tuple[Task, ...]:
    """The tasks of the first level that asks for anything; observers, which only react, do not count."""
    for level in priorities.levels:
        tasks = tuple(task for task in level.tasks if task.type not in ("reactive", "preventive", "posture"))
        if tasks:
            return tasks
    return ()


def top_level_error(run: RunResult) -> float | None:
    """Largest error, m or rad, of any task of the highest level of the last stage, over the run.

    Measured: positions that are landmarks or sensors, the centre of mass, soles that are to be flat, axes. None where
    the level holds nothing of the kind.
    """
    if not run.priorities:
        return None
    errors = [error for task in top_tasks(run.priorities[-1]) for error in _errors(task, run)]
    known = [float(np.nanmax(error)) for error in errors if np.isfinite(error).any()]
    return max(known) if known else None


def _errors(task: Task, run: RunResult) -> Iterable[FloatArray]:
    """Error (T,) of each part of a task that can be measured from outside."""
    robot, sent = run.robot, run.record.robot
    if isinstance(task, CentreOfMassTask):
        if robot is None or sent is None:
            yield run.record.human.balance_error
        elif task.mode == "support" and robot.stands:
            soles = standing.soles_of(robot, sent.q)
            corners = np.concatenate([standing.sole_corners(sole) for sole in soles], axis=1)
            com = robot.body.solver_body().centre_of_mass(np.ascontiguousarray(sent.q))
            yield np.maximum(task.margin - standing.support_margin(com, corners), 0.0)
    elif isinstance(task, PositionTask):
        names, asked, reached = run.followed
        errors = tracking.distances(asked * _rows(task), reached * _rows(task))
        yield from (_locked(run, name, errors[:, names.index(name)]) for name in task.of if name in names)
    elif robot is not None and sent is not None:
        if isinstance(task, OrientationTask):
            flat = {foot.frame for foot in robot.profile.feet.values()}
            yield from (_locked(run, name, _from_upright(robot, sent.q, name)) for name in task.of if name in flat)
        elif isinstance(task, AxisTask):
            yield from (_off_axis(task, robot, sent.q, name) for name in task.of if name in robot.profile.frames)


def _locked(run: RunResult, name: str, error: FloatArray) -> FloatArray:
    """The error (T,) of a sole while it is on the floor: one that swings is no task of this level. All of others."""
    robot, sent = run.robot, run.record.robot
    if run.steps is None or robot is None or sent is None:
        return error
    if name not in {foot.frame for foot in robot.profile.feet.values()}:
        return error
    return np.where(robot.points(sent.q, (name,))[:, 0, 2] > LIFTED_M, np.nan, error)


def _rows(task: PositionTask) -> FloatArray:
    """1 for the rows that the task asks for, else 0."""
    return np.array([float(weight > 0.0) for weight in task.weight])


def _from_upright(robot: RobotBody, q: FloatArray, frame: str) -> FloatArray:
    """Angle (T,) rad between a frame's z axis and the vertical."""
    up = rotations.rotate(robot.orientations(q, (frame,))[:, 0], np.array([0.0, 0.0, 1.0]))
    return np.asarray(np.arccos(np.clip(up[:, 2], -1.0, 1.0)))


def _off_axis(task: AxisTask, robot: RobotBody, q: FloatArray, frame: str) -> FloatArray:
    """Angle (T,) rad between an axis of a frame and where it is to point, in the robot's world."""
    axis = np.array(task.axis) / np.linalg.norm(task.axis)
    direction = np.array(task.direction) / np.linalg.norm(task.direction)
    turned = rotations.rotate(robot.orientations(q, (frame,))[:, 0], axis)
    return np.asarray(np.arccos(np.clip(turned @ direction, -1.0, 1.0)))
