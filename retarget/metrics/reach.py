"""How well hands are followed where the robot's arms can get there at all."""

from dataclasses import dataclass
from itertools import takewhile

import numpy as np
from numpy.typing import NDArray

from retarget import _solver
from retarget.frames import BoolArray
from retarget.metrics.asked_arms import Performance, asked_arms
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from retarget.stance import Stance, plant

__all__ = ["Reachable", "chain_to_anchor", "reachable_hands", "within_reach"]

EVERY = 20
"""Every so manyth tick is looked at."""
WITHIN_M = 0.002
"""The arm gets there when it gets this near, m."""
SEEDS, TRIES = 500, 12
"""Postures of the arm, spread over its ranges, of which the nearest begin a search each: one may end in a corner."""
STEPS = 40


@dataclass(frozen=True)
class Reachable:
    """One hand. share: of the ticks that ask for it, those within reach; error: mean distance (m) at those, or None."""

    share: float
    error: float | None


def reachable_hands(robot: RobotBody, asked: Performance, reached: FloatArray) -> dict[str, Reachable]:
    """How each hand followed at the ticks at which it was asked within reach; reached (T, k, 3) m: as the landmarks.

    Within reach: from the torso that is asked, the arm gets there within the position limits of its joints, at any
    speed. Where the robot was takes no part in that.
    """
    stance, found = plant(robot, robot.profile.postures.stand), {}
    for name, places in asked_arms(robot, stance, asked).items():
        column = asked.landmark_names.index(name)
        error = np.linalg.norm(reached[::EVERY, column] - asked.landmarks[::EVERY, column], axis=1)
        error = error[known := np.isfinite(error)]
        within = within_reach(robot, stance, name, places[::EVERY][known])
        found[name] = Reachable(
            share=float(within.mean()) if within.size else 0.0,
            error=float(error[within].mean()) if within.any() else None,
        )
    return found


def within_reach(robot: RobotBody, stance: Stance, landmark: str, places: FloatArray) -> BoolArray:
    """Whether (T,) the limb of a landmark gets to each place (T, 3) m while the rest stays in its stance."""
    body, frame = robot.body, robot.profile.landmarks[landmark].frame
    place, moving = robot.frame(frame), body.joint_dof[list(chain_to_anchor(robot, landmark))]
    lower, upper = body.lower.copy(), body.upper.copy()
    dofs = [body.dof_index(joint) for joint in robot.joint_map.joints]
    lower[dofs], upper[dofs] = robot.joint_map.lower, robot.joint_map.upper
    _, columns = body.scalar_joints()
    seeds = np.tile(stance.q, (SEEDS, 1))
    spread = np.random.default_rng(0).uniform(lower[moving], upper[moving], (SEEDS, moving.size))
    seeds[:, columns[moving]] = spread
    starts = robot.points(seeds, (frame,))[:, 0]
    solver = _arm_solver(robot, place.body, place.position, moving, lower, upper)

    def gets_to(at: FloatArray) -> bool:
        for seed in np.argsort(np.linalg.norm(starts - at, axis=1))[:TRIES]:
            solver.reset(seeds[seed])
            solver.frame(np.concatenate([[1.0], at]), 1.0)
            if solver.task_errors[0] <= WITHIN_M:
                return True
        return False

    return np.array([gets_to(at) for at in places], dtype=np.bool_)


def chain_to_anchor(robot: RobotBody, landmark: str) -> tuple[int, ...]:
    """Joints between a landmark's frame and the link that carries its first anchor, or the root of the body."""
    entry, body = robot.profile.landmarks[landmark], robot.body
    base = robot.frame(entry.anchor[0]).body
    links = takewhile(lambda link: link != base, body.chain_to_root(robot.frame(entry.frame).body))
    return tuple(joint for link in links for joint in np.flatnonzero(body.joint_body == link).tolist())


def _arm_solver(
    robot: RobotBody, link: int, point: FloatArray, moving: NDArray[np.int64], lower: FloatArray, upper: FloatArray
) -> _solver.Solver:
    """One task, only the DoFs `moving` (d,) free, position limits (nv,), no others."""
    body = robot.body
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
    )
