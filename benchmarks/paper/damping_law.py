"""The paper's Figure 4: four points move beside a sphere, and what the solver leaves of their displacements."""

from dataclasses import dataclass

import numpy as np

from benchmarks.paper.solver_rig import Ball, make_solver, place_balls, sliding_point, watching
from retarget import _solver
from retarget.types import FloatArray

BALL = Ball(centre=(0.0, 0.0, 0.0), radius=0.5, influence=0.6)
POINTS: tuple[tuple[str, tuple[float, float, float], tuple[float, float, float]], ...] = (
    ("e1", (-1.05, 0.0, 0.95), (0.30, 0.0, 0.12)),
    ("e2", (0.18, 0.0, 0.98), (0.16, 0.0, -0.34)),
    ("e3", (0.62, 0.0, 0.20), (-0.30, 0.0, 0.16)),
    ("e4", (-0.62, 0.0, -0.25), (-0.26, 0.0, -0.24)),
)
"""Name, position (m) and displacement asked (m): outside, inside influence, nearer, and moving away."""


@dataclass(frozen=True, eq=False)
class DampedPoint:
    """A point of the figure. share: alpha, what stays of the approach (1 outside of influence); vectors (3,) m."""

    name: str
    position: FloatArray
    asked: FloatArray
    got: FloatArray
    normal: FloatArray
    share: float
    acted: bool


def damped_points() -> list[DampedPoint]:
    """Each point by itself: one frame of one iteration towards position + displacement."""
    return [_damped(name, np.array(position), np.array(asked)) for name, position, asked in POINTS]


def _damped(name: str, position: FloatArray, asked: FloatArray) -> DampedPoint:
    body = sliding_point()
    levels = [[_solver.Task.preventive()], [_solver.Task.position(1, max_error=10.0)]]
    solver = make_solver(body, levels, watching(body, 0.0, [BALL]), n_ik=1)
    solver.reset(position)
    place_balls(solver, [BALL])
    targets = np.ones(solver.target_size)
    start, stop = solver.target_slice(1, 0)
    targets[start + 1 : stop] = position + asked
    got = solver.frame(targets, 1.0) - position
    offset = position - np.array(BALL.centre)
    far = float(np.linalg.norm(offset))
    share = float(np.clip((far - BALL.radius) / BALL.influence, 0.0, 1.0))
    return DampedPoint(name, position, asked, got, offset / far, share, bool(solver.observer_modes[0] == 1))
