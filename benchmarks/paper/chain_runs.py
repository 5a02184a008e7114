"""The paper's Figures 5 and 6: chains in a plane that yield to a moving sphere, and reach past still ones."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.paper.solver_rig import (
    LINK,
    Ball,
    chain_points,
    make_solver,
    place_balls,
    planar_chain,
    watching,
)
from retarget import _solver
from retarget.model.body import BodyModel
from retarget.types import FloatArray

DT = 0.01
"""s per frame."""
APPROACH = Ball(centre=(-0.45, 0.0, 0.27), radius=0.09, influence=0.12, velocity=(0.25, 0.0, 0.0))
"""The sphere that comes (Figure 5)."""
ONE = (Ball(centre=(0.27, 0.0, 0.28), radius=0.10, influence=0.13),)
TWO = (*ONE, Ball(centre=(0.60, 0.0, 0.42), radius=0.08, influence=0.12))
"""What stands between a chain and its goal (Figure 6 a and b)."""
GOAL = (0.50, 0.0, 0.10)
START_RAD = 0.02
"""Of every joint of a chain that reaches: it leans a little towards its goal."""
REACH_SPEED = 0.6
"""Of what the tip is asked, on its straight way to the goal, m/s."""

Targets = Callable[[float], FloatArray]
"""Target vector at a time, s."""


@dataclass(frozen=True, eq=False)
class ChainRun:
    """T postures of a chain.

    points (T, links + 1, 3) m; modes (T, links): 0 free, 1 preventive, 2 reactive; clearance (T, links, k) m of each
    link to each ball; centres (T, k, 3) m of the balls; goal (3,) m or None.
    """

    points: FloatArray
    modes: FloatArray
    clearance: FloatArray
    balls: tuple[Ball, ...]
    centres: FloatArray
    goal: FloatArray | None

    @property
    def within(self) -> FloatArray:
        """Which links (T, links, k) are within influence of which ball."""
        return np.asarray(self.clearance < np.array([ball.influence for ball in self.balls]))


def yielding_chain(*, links: int = 4, seconds: float = 2.2, iterations: int = 5) -> ChainRun:
    """A still chain, drawn to no posture but that it has, and a sphere that comes against it."""
    body = planar_chain(links)
    levels = [[_solver.Task.reactive()], [_solver.Task.preventive()], [_solver.Task.posture(np.ones(links))]]
    solver = make_solver(body, levels, watching(body, LINK, [APPROACH]), n_ik=iterations)
    targets = np.ones(solver.target_size)
    start, stop = solver.target_slice(2, 0)
    targets[start + 1 : stop] = 0.0
    return _run(body, solver, (APPROACH,), round(seconds / DT), lambda time: targets)


def reaching_chain(balls: Sequence[Ball], *, links: int = 10, seconds: float = 2.6, iterations: int = 1) -> ChainRun:
    """A chain reaches for a low goal past still balls. One iteration a frame, so that modes say who acted."""
    body = planar_chain(links)
    tip, goal = body.frame("tip"), np.array(GOAL)
    levels = [
        [_solver.Task.reactive()],
        [_solver.Task.preventive()],
        [_solver.Task.position(tip.body, (0.0, 0.0, LINK), weight=(1.0, 0.0, 1.0), max_error=0.02)],
        [_solver.Task.posture(np.ones(links), gain=0.02)],
    ]
    solver = make_solver(body, levels, watching(body, LINK, balls), n_ik=iterations, speed=8.0)
    targets = np.ones(solver.target_size)
    start, stop = solver.target_slice(3, 0)
    targets[start + 1 : stop] = START_RAD
    above = np.array([0.0, 0.0, links * LINK])
    way = goal - above
    length = float(np.linalg.norm(way))
    at = slice(*solver.target_slice(2, 0))

    def asked(time: float) -> FloatArray:
        targets[at] = [1.0, *(above + way * min(REACH_SPEED * time / length, 1.0))]
        return targets

    return _run(body, solver, tuple(balls), round(seconds / DT), asked, goal=goal)


def _run(
    body: BodyModel,
    solver: _solver.Solver,
    balls: tuple[Ball, ...],
    frames: int,
    targets: Targets,
    *,
    goal: FloatArray | None = None,
) -> ChainRun:
    q = [np.full(body.nq, START_RAD if goal is not None else 0.0)]
    solver.reset(q[0])
    modes = [solver.observer_modes]
    for k in range(frames):
        place_balls(solver, balls, k * DT)
        q.append(solver.frame(targets(k * DT), DT))
        modes.append(solver.observer_modes)
    points = chain_points(body, np.array(q))
    centres = np.array([[ball.after(k * DT) for ball in balls] for k in range(frames + 1)])
    radii = np.array([ball.radius for ball in balls])
    clearance = _to_segments(points, centres) - radii
    return ChainRun(points, np.array(modes), clearance, balls, centres, goal)


def _to_segments(points: FloatArray, centres: FloatArray) -> FloatArray:
    """Distances (T, links, k) of centres (T, k, 3) to the lines between neighbouring points (T, links + 1, 3)."""
    start, along = points[:, :-1, None], np.diff(points, axis=1)[:, :, None]
    to = centres[:, None] - start
    share = np.clip((to * along).sum(axis=-1) / (along * along).sum(axis=-1), 0.0, 1.0)
    return np.asarray(np.linalg.norm(to - share[..., None] * along, axis=-1))
