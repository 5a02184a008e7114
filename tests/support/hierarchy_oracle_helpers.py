"""One answer of the solver."""

from dataclasses import dataclass

import numpy as np

from oracles.problem import Array, Hierarchy
from retarget import _solver


@dataclass(frozen=True)
class Answer:
    """x (n,). steps: limits taken up or dropped. capped: it was ended early."""

    x: Array
    steps: int
    capped: bool


def solve(problem: Hierarchy, damping: float = 0.0, rounds: int = 1) -> Answer:
    """One linear solve by the code under test, in z = weight (x - ref); every level is damped alike. Soft rows are one
    more level, with a slack variable each."""
    levels = [(np.vstack([level.C, level.D]), *level.limits) for level in problem.levels]
    slacks = 0 if problem.soft is None else len(problem.soft[1])
    if problem.soft is not None:
        levels.append((problem.soft[0], problem.soft[1], problem.soft[1]))
    x_rows = np.vstack([np.zeros((0, problem.nv)), *(rows for rows, *_ in levels)])
    sizes = [len(rows) for rows, *_ in levels]
    own_slack = np.eye(len(x_rows))[:, len(x_rows) - slacks :]
    lower, upper = (np.concatenate([np.zeros(0), *(level[k] for level in levels)]) for k in (1, 2))
    shift = x_rows @ problem.ref
    free = np.full(slacks, np.inf)
    z, steps, capped = _solver.solve_hierarchy(
        np.hstack([x_rows / problem.weight, own_slack]),
        lower - shift,
        upper - shift,
        sizes,
        lo=np.append((problem.lo - problem.ref) * problem.weight, -free),
        hi=np.append((problem.hi - problem.ref) * problem.weight, free),
        still=np.append(-problem.ref * problem.weight, np.zeros(slacks)),
        damping=damping,
        soft_last=problem.soft is not None,
        rounds=rounds,
    )
    x = np.clip(problem.ref + z[: problem.nv] / problem.weight, problem.lo, problem.hi)
    return Answer(x, steps, capped)
