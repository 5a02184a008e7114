"""PlaCo with its self-collision avoidance on the pairs that our observers look at."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import placo

from benchmarks.bodies import BenchBody, Floats
from benchmarks.motion import Motion
from benchmarks.observed_body import Watched
from benchmarks.observed_shapes import urdf_names, urdf_shapes
from benchmarks.peer_placo import Placo
from benchmarks.urdf import write_urdf


class ObservedPlaco(Placo):
    """PlaCo; its trigger is our influence, its margin ours. It knows self collision alone, no obstacles."""

    def __init__(self, body: BenchBody, motion: Motion, *, watched: Watched, leading: str) -> None:
        self.watched, self.leading, self.name = watched, leading, f"PlaCo {leading}"
        super().__init__(body, motion)
        constraint = self.solver.add_avoid_self_collisions_constraint()
        constraint.self_collisions_margin = float(watched.observers.margin.max())
        constraint.self_collisions_trigger = float(watched.observers.influence.max())
        constraint.configure("self collision", "hard")

    def make_robot(self, body: BenchBody) -> Any:
        """The body with our shapes, and our pairs, by number among its shapes."""
        with tempfile.TemporaryDirectory() as folder:
            Path(folder, "robot.urdf").write_text(write_urdf(body, urdf_shapes(self.watched)), encoding="utf-8")
            pairs = Path(folder, "collisions.json")
            pairs.write_text(
                "[]", encoding="utf-8"
            )  # without this file it looks at all pairs, and warns of those that touch
            robot = placo.RobotWrapper(folder)
            shapes = [robot.collision_model.getGeometryId(name) for name in urdf_names(self.watched)]
            self.pairs = [(shapes[a], shapes[b]) for a, b in self.watched.observers.pairs.tolist()]
            pairs.write_text(json.dumps(self.pairs), encoding="utf-8")
            robot.load_collision_pairs(str(pairs))
        return robot

    def distances(self) -> Floats:
        """What it finds for every pair (p,) m where it stands; NaN for what it does not look at."""
        found = {frozenset((one.objA, one.objB)): one.min_distance for one in self.robot.distances()}
        return np.array([found.pop(frozenset(pair), np.nan) for pair in self.pairs])

    @property
    def pair_count(self) -> int:
        """Pairs that it looks at."""
        return len(self.robot.distances())


def observed_placo(watched: Watched, leading: str) -> Callable[[BenchBody, Motion], ObservedPlaco]:
    """A side by these choices, to be made for a body and a motion. leading: hard or soft."""
    return partial(ObservedPlaco, watched=watched, leading=leading)
