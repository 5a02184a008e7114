"""Our side: strict levels as in Table 1 of the paper; with observers, collisions are avoided as priority files ask."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Literal

import numpy as np

from benchmarks.bodies import BenchBody, Floats
from benchmarks.motion import Motion
from benchmarks.observed_body import NOTHING, StaticObstacles, Watched
from benchmarks.side import DT, N_IK, POSTURE_GAIN
from retarget import _solver
from retarget._solver import Task

Activation = Literal["closest", "all"]
Levels = list[list[Task]]


class Ours:
    """`retarget._solver`: centre of mass; ankles; wrists and head; posture.

    over: link that the centre of mass is asked over; its targets are then offsets. watched, activation: observers that
    look at each other and at obstacles at rest; without an activation they do not look at all.
    """

    def __init__(
        self,
        body: BenchBody,
        motion: Motion,
        *,
        name: str = "retarget",
        over: int | None = None,
        watched: Watched | None = None,
        activation: Activation | None = None,
        around: StaticObstacles = NOTHING,
    ) -> None:
        self.name = name
        points = [Task.position(link, point.at) for link, point in zip(body.links(), body.points, strict=True)]
        com = Task.centre_of_mass(weight=motion.com_rows, over=over)
        hinges = np.ones(body.model.nv)
        hinges[:6] = 0.0
        posture = Task.posture(hinges, gain=POSTURE_GAIN)
        ankles = [task for task, point in zip(points, body.points, strict=True) if "ankle" in point.name]
        first = [[com], ankles]
        if watched is not None:
            first = _with_observers(watched, com, ankles, scene=len(around.kinds) > 0, avoid=activation is not None)
        levels = [*first, [task for task in points if task not in ankles], [posture]]
        self.solver = _make_solver(body, levels, watched, activation, around)
        self.solver.reset(motion.start)
        if activation is not None and len(around.kinds):
            self.solver.set_obstacles(around.position, around.quat)
        self.targets = np.zeros(self.solver.target_size)
        places = {
            id(task): self.solver.target_slice(k, t) for k, level in enumerate(levels) for t, task in enumerate(level)
        }
        for start, _ in places.values():
            self.targets[start] = 1.0  # switched on
        self.com, *self.places, at_rest = (
            slice(places[id(task)][0] + 1, places[id(task)][1]) for task in (com, *points, posture)
        )
        self.targets[at_rest] = body.attractor

    @property
    def failures(self) -> int:
        """Solves that were capped."""
        return self.solver.capped

    def aim(self, com: Floats, points: Floats) -> None:
        """See `Side`."""
        self.targets[self.com] = com
        for place, point in zip(self.places, points, strict=True):
            self.targets[place] = point

    def solve(self) -> None:
        """See `Side`."""
        self.solver.frame(self.targets, DT)

    def posture(self) -> Floats:
        """See `Side`."""
        return self.solver.q


def observed(
    name: str, watched: Watched, activation: Activation | None, around: StaticObstacles = NOTHING
) -> Callable[[BenchBody, Motion], Ours]:
    """A side with observers, to be made for a body and a motion."""
    return partial(Ours, name=name, watched=watched, activation=activation, around=around)


def _with_observers(watched: Watched, com: Task, ankles: list[Task], *, scene: bool, avoid: bool) -> Levels:
    """The first levels as in paper.yaml where ankles lead, as in servo.yaml where observers do."""
    if watched.first == "ankles":
        return [[com], ankles, *([[Task.reactive()], [Task.preventive()]] if avoid else [])]
    if not avoid:
        return [ankles, [com]]
    itself = [Task.reactive(against="self"), Task.preventive(against="self")]
    fixtures = [Task.reactive(against="scene"), Task.preventive(against="scene")]
    return [itself, ankles, [com], *([fixtures] if scene else [])]


def _make_solver(
    body: BenchBody, levels: Levels, watched: Watched | None, activation: Activation | None, around: StaticObstacles
) -> _solver.Solver:
    model = body.model
    speed = np.full(model.nv, body.max_speed)
    speed[:6] = np.inf
    return _solver.Solver(
        model.solver_body(),
        levels,
        lower=model.lower,
        upper=model.upper,
        max_velocity=speed,
        max_acceleration=np.full(model.nv, np.inf),
        locked=body.locked,
        n_ik=N_IK,
        early_stop=False,
        observers=None if watched is None or activation is None else _for_solver(watched, around),
        activation=activation or "closest",
    )


def _for_solver(watched: Watched, around: StaticObstacles) -> _solver.Observers:
    seen, count = watched.observers, len(around.kinds)
    return _solver.Observers(
        watched.body.model.solver_body(),
        links=seen.links,
        kinds=seen.kinds,
        sizes=seen.sizes,
        positions=seen.positions,
        quats=seen.quats,
        influence=seen.influence,
        margin=seen.margin,
        pairs=seen.pairs,
        obstacle_kinds=around.kinds,
        obstacle_sizes=around.sizes,
        obstacle_influence=np.full(count, around.influence),
        obstacle_margin=np.zeros(count),
    )
