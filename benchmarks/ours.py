"""Our side: strict levels as in Table 1 of the paper, without the observers."""

from __future__ import annotations

import numpy as np

from benchmarks.bodies import BenchBody, Floats
from benchmarks.motion import Motion
from benchmarks.side import DT, N_IK, POSTURE_GAIN
from retarget._solver import Solver, Task


class Ours:
    """`retarget._solver`: centre of mass; ankles; wrists and head; posture."""

    name = "retarget"
    over: int | None = None  # link that the centre of mass is asked over; its targets are then offsets

    def __init__(self, body: BenchBody, motion: Motion) -> None:
        model = body.model
        hinges = np.ones(model.nv)
        hinges[:6] = 0.0
        tasks = [Task.position(link, point.at) for link, point in zip(body.links(), body.points, strict=True)]
        ankles = [task for task, point in zip(tasks, body.points, strict=True) if "ankle" in point.name]
        rest = [task for task, point in zip(tasks, body.points, strict=True) if "ankle" not in point.name]
        posture = Task.posture(hinges, gain=POSTURE_GAIN)
        levels = [[Task.centre_of_mass(weight=motion.com_rows, over=self.over)], ankles, rest, [posture]]
        speed = np.full(model.nv, body.max_speed)
        speed[:6] = np.inf
        self.solver = Solver(
            model.solver_body(),
            levels,
            lower=model.lower,
            upper=model.upper,
            max_velocity=speed,
            max_acceleration=np.full(model.nv, np.inf),
            locked=body.locked,
            n_ik=N_IK,
            early_stop=False,
        )
        self.solver.reset(motion.start)
        self.targets = self.lay_out(body, levels)
        start, stop = self.solver.target_slice(3, 0)
        self.targets[start:stop] = [1.0, *body.attractor]

    def lay_out(self, body: BenchBody, levels: list[list[Task]]) -> Floats:
        """Find each target's place in the flat vector, and switch its task on."""
        targets = np.zeros(self.solver.target_size)
        slices = [self.solver.target_slice(k, t) for k in range(3) for t in range(len(levels[k]))]
        for start, _ in slices:
            targets[start] = 1.0
        self.com = slice(slices[0][0] + 1, slices[0][1])
        order = [i for ankle in (True, False) for i, p in enumerate(body.points) if ("ankle" in p.name) == ankle]
        self.places = [(i, slice(start + 1, stop)) for i, (start, stop) in zip(order, slices[1:], strict=True)]
        return targets

    @property
    def failures(self) -> int:
        """Solves that were capped."""
        return self.solver.stats["capped"]

    def aim(self, com: Floats, points: Floats) -> None:
        """See `Side`."""
        self.targets[self.com] = com
        for index, place in self.places:
            self.targets[place] = points[index]

    def solve(self) -> None:
        """See `Side`."""
        self.solver.frame(self.targets, DT)

    def posture(self) -> Floats:
        """See `Side`."""
        return self.solver.q


class OursOverRoot(Ours):
    """The same, with the centre of mass over the root as in the paper; PlaCo and mink have no such task."""

    over = 1
