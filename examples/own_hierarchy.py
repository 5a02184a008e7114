"""Strict priorities: a hand is asked for a point out of reach; balance and feet do not give a millimetre."""

import numpy as np

from retarget._solver import Solver, Task
from retarget.model.human import build_human
from retarget.model.human_dimensions import proportional_dimensions


def main() -> None:
    """Ask for the impossible for a second, and print who paid for it."""
    human = build_human(proportional_dimensions(1.75))
    body, start = human.body, human.posture("attractor")
    solver_body = body.solver_body()
    frames = [body.frame(name) for name in ("l_ankle", "r_ankle", "r_wrist")]
    points = solver_body.points(start[None], [f.body for f in frames], np.array([f.position for f in frames]))[0]
    points[2] += [2.0, 0.0, 0.0]

    tasks = [Task.position(f.body, tuple(f.position)) for f in frames]
    balance = Task.centre_of_mass(weight=(1.0, 1.0, 0.0), over=body.body_index("pelvis"))
    levels = [[balance], tasks[:2], tasks[2:], [Task.posture(np.ones(body.nv), gain=0.1)]]
    anything = np.full(body.nv, np.inf)
    limits = {"lower": body.lower, "upper": body.upper, "max_velocity": anything, "max_acceleration": anything}
    solver = Solver(solver_body, levels, locked=human.locked, **limits)
    solver.reset(start)

    targets = np.concatenate([[1, 0, 0, 0], *([1, *p] for p in points), [1], start]).astype(float)
    for _ in range(120):
        solver.frame(targets, 1 / 120)
    for name, error in zip(("centre of mass", "l_ankle", "r_ankle", "r_wrist"), solver.task_errors, strict=False):
        print(f"{name:15s} {1000 * error:8.2f} mm off")


if __name__ == "__main__":
    main()
