"""How well hands are followed where the robot's arms can get there at all."""

import numpy as np
from numpy.typing import NDArray

from retarget import _solver
from retarget.record import RobotRecord
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray

__all__ = ["chain_to_anchor", "reachable_error"]

EVERY = 20
"""Every so manyth tick is looked at."""
WITHIN_M = 0.002
"""The arm gets there when it gets this near, m."""
STEPS = 25


def reachable_error(robot: RobotBody, sent: RobotRecord) -> float | None:
    """Mean distance (m) of hands sent from hands asked, over the ticks at which the arm alone can reach what is asked.

    From the posture sent, the joints between the hand and its anchor move within their position limits, at any speed;
    the torso stays. None where no hand is ever asked within reach.
    """
    errors = [
        error
        for column, name in enumerate(sent.landmark_names)
        if name in ("l_hand", "r_hand")
        for error in _reached_where_possible(robot, sent, column)
    ]
    return float(np.mean(errors)) if errors else None


def chain_to_anchor(robot: RobotBody, landmark: str) -> tuple[int, ...]:
    """Joints between a landmark's frame and the link that carries its first anchor, or the root of the body."""
    entry, body = robot.profile.landmarks[landmark], robot.body
    link = robot.frame(entry.frame).body
    base = robot.frame(entry.anchor[0]).body
    joints: list[int] = []
    while link not in (0, base):
        joints += np.flatnonzero(body.joint_body == link).tolist()
        link = int(body.parent[link])
    return tuple(joints)


def _reached_where_possible(robot: RobotBody, sent: RobotRecord, column: int) -> list[float]:
    """Error (m) of one landmark at every tick looked at at which it can be reached."""
    name = sent.landmark_names[column]
    body, place = robot.body, robot.frame(robot.profile.landmarks[name].frame)
    moving = body.joint_dof[list(chain_to_anchor(robot, name))]
    solver = _arm_solver(robot, place.body, place.position, moving)
    rows = np.arange(0, len(sent.q), EVERY)
    asked = sent.landmarks_asked[rows, column]
    achieved = robot.points(sent.q[rows], (place.name,))[:, 0]
    error = np.linalg.norm(achieved - asked, axis=1)
    found = []
    for row in np.flatnonzero(np.isfinite(error)):
        if error[row] > WITHIN_M:
            solver.reset(sent.q[rows[row]])
            best = solver.frame(np.concatenate([[1.0], asked[row]]), 1.0)[None]
            if np.linalg.norm(robot.points(best, (place.name,))[0, 0] - asked[row]) > WITHIN_M:
                continue
        found.append(float(error[row]))
    return found


def _arm_solver(robot: RobotBody, link: int, point: FloatArray, moving: NDArray[np.int64]) -> _solver.Solver:
    """One task, only the DoFs `moving` (d,) free, position limits of the servos, no others."""
    body, servos = robot.body, robot.joint_map
    lower, upper = body.lower.copy(), body.upper.copy()
    dofs = [body.dof_index(joint) for joint in servos.joints]
    lower[dofs], upper[dofs] = servos.lower, servos.upper
    locked = np.ones(body.nv, dtype=np.bool_)
    locked[moving] = False
    unlimited = np.full(body.nv, np.inf)
    x, y, z = point.tolist()
    return _solver.Solver(
        body.solver_body(),
        [[_solver.Task.position(link, (x, y, z))]],
        lower=lower,
        upper=upper,
        max_velocity=unlimited,
        max_acceleration=unlimited,
        locked=locked,
        n_ik=STEPS,
        early_stop=False,
    )
