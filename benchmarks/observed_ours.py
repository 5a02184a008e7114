"""Our side with observers: the benchmark's levels, and collision avoidance where the priority files have it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from benchmarks.bodies import BenchBody, Floats
from benchmarks.motion import Motion
from benchmarks.observed_body import NOTHING, StaticObstacles, Watched
from benchmarks.ours import Ours
from benchmarks.side import N_IK, POSTURE_GAIN
from retarget import _solver
from retarget._solver import Task

Activation = Literal["closest", "all"]
Kind = Literal["com", "point", "avoid", "posture"]


@dataclass(frozen=True)
class Asked:
    """A task, and whose target it takes. point: number among the body's points."""

    task: Task
    kind: Kind
    point: int = -1


class ObservedOurs(Ours):
    """`retarget._solver` with observers that look at each other and at obstacles at rest. activation None: they do not
    look at all, and there are no levels for them."""

    def __init__(
        self,
        body: BenchBody,
        motion: Motion,
        *,
        watched: Watched,
        activation: Activation | None,
        around: StaticObstacles = NOTHING,
        name: str = "retarget",
    ) -> None:
        self.name = name
        tasks = _levels(watched, motion, scene=len(around.kinds) > 0, avoid=activation is not None)
        self.solver = _make_solver(body, tasks, watched, activation, around)
        self.solver.reset(motion.start)
        if activation is not None and len(around.kinds):
            self.solver.set_obstacles(around.position, around.quat)
        self.targets = np.zeros(self.solver.target_size)
        self.com: slice = slice(0)
        self.places: list[tuple[int, slice]] = []
        for level, asked in enumerate(tasks):
            for index, one in enumerate(asked):
                self._place(one, *self.solver.target_slice(level, index), body.attractor)

    def _place(self, asked: Asked, start: int, stop: int, attractor: Floats) -> None:
        """Switch a task on and remember where its target goes."""
        self.targets[start] = 1.0
        target = slice(start + 1, stop)
        if asked.kind == "com":
            self.com = target
        elif asked.kind == "point":
            self.places.append((asked.point, target))
        elif asked.kind == "posture":
            self.targets[target] = attractor


def observed(
    name: str, watched: Watched, activation: Activation | None, around: StaticObstacles = NOTHING
) -> Callable[[BenchBody, Motion], ObservedOurs]:
    """A side by these choices, to be made for a body and a motion."""
    return partial(ObservedOurs, watched=watched, activation=activation, around=around, name=name)


def _levels(watched: Watched, motion: Motion, *, scene: bool, avoid: bool) -> list[list[Asked]]:
    """As in paper.yaml where ankles lead, as in servo.yaml where observers do."""
    body = watched.body
    points = [
        Asked(Task.position(link, point.at), "point", k)
        for k, (link, point) in enumerate(zip(body.links(), body.points, strict=True))
    ]
    ankles = [asked for asked in points if "ankle" in body.points[asked.point].name]
    rest = [asked for asked in points if asked not in ankles]
    com = [Asked(Task.centre_of_mass(weight=motion.com_rows), "com")]
    hinges = np.ones(body.model.nv)
    hinges[:6] = 0.0
    posture = [Asked(Task.posture(hinges, gain=POSTURE_GAIN), "posture")]
    if not avoid:
        first = [com, ankles] if watched.first == "ankles" else [ankles, com]
    elif watched.first == "ankles":
        first = [com, ankles, [_asked(Task.reactive())], [_asked(Task.preventive())]]
    else:
        itself = [_asked(Task.reactive(against="self")), _asked(Task.preventive(against="self"))]
        fixtures = [_asked(Task.reactive(against="scene")), _asked(Task.preventive(against="scene"))]
        first = [itself, ankles, com, *([fixtures] if scene else [])]
    return [*first, rest, posture]


def _asked(task: Task) -> Asked:
    return Asked(task, "avoid")


def _make_solver(
    body: BenchBody, levels: list[list[Asked]], watched: Watched, activation: Activation | None, around: StaticObstacles
) -> _solver.Solver:
    model = body.model
    speed = np.full(model.nv, body.max_speed)
    speed[:6] = np.inf
    return _solver.Solver(
        model.solver_body(),
        [[asked.task for asked in level] for level in levels],
        lower=model.lower,
        upper=model.upper,
        max_velocity=speed,
        max_acceleration=np.full(model.nv, np.inf),
        locked=body.locked,
        n_ik=N_IK,
        early_stop=False,
        observers=None if activation is None else _for_solver(watched, around),
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
