"""What a sensor and a degree of freedom cost: our frame with more of each."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.bodies import BenchBody, Point
from benchmarks.motion import crouch_and_reach
from benchmarks.ours import Ours

FRAMES = 240
EXTRA_POINTS = ("l_elbow", "r_elbow", "l_knee", "r_knee", "pelvis")


@dataclass(frozen=True)
class Cost:
    """Median thread CPU of one frame, us."""

    body: str
    sensors: int
    degrees_of_freedom: int
    median_us: float


def per_sensor(human: BenchBody) -> list[Cost]:
    """One to ten sensors on the human: ankles, wrists, head, then elbows, knees, pelvis."""
    points = (*human.points, *(Point(name, name) for name in EXTRA_POINTS))
    return [time_ours(replace(human, points=points[:k])) for k in range(1, len(points) + 1)]


def per_degree_of_freedom(human: BenchBody, op3: BenchBody) -> list[Cost]:
    """Five sensors on OP3, and on the human with more and more of its joints locked."""
    model = human.model
    keep = [model.dof_index(name) for name in human.swing]
    order = [d for d in range(model.nv - 1, 5, -1) if d not in keep]  # the ends of the limbs first
    costs = [time_ours(op3)]
    for count in (42, 33, 24, 0):
        locked = np.zeros(model.nv, dtype=bool)
        locked[order[:count]] = True
        costs.append(time_ours(replace(human, locked=locked if count else human.locked)))
    return [*costs, time_ours(replace(human, locked=np.zeros(model.nv, dtype=bool)))]


def time_ours(body: BenchBody) -> Cost:
    """Our frame on the easy motion."""
    motion = crouch_and_reach(body, FRAMES)
    ours = Ours(body, motion)
    spent = []
    for com, points in zip(motion.com, motion.points, strict=True):
        ours.aim(com, points)
        before = time.thread_time_ns()
        ours.solve()
        spent.append(time.thread_time_ns() - before)
    return Cost(body.name, len(body.points), body.degrees_of_freedom, float(np.median(spent)) / 1e3)


def slope(costs: list[Cost], field: str) -> float:
    """Microseconds per unit of `field`, by least squares over one body's costs."""
    x = np.array([getattr(cost, field) for cost in costs], dtype=float)
    return float(np.polyfit(x, [cost.median_us for cost in costs], 1)[0])
