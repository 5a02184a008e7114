"""One answer of the solver, held to the box, to optimality, and level by level to the oracle."""

from dataclasses import dataclass

import numpy as np

from oracles.cascade import solve_cascade
from oracles.optimality import optimality, outside_box
from oracles.problem import Array, Hierarchy
from retarget import _solver

EQUAL = 1e-6  # residual of a level against the oracle's
OPTIMAL = 1e-7  # unexplained share of a level's gradient


@dataclass(frozen=True)
class Answer:
    """x (n,). reduced: it was found in the space that the first equalities leave. capped: it is not proved optimal."""

    x: Array
    reduced: bool
    capped: bool


def solve(problem: Hierarchy, damping: float = 0.0) -> Answer:
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
    z, reduced, capped = _solver.solve_hierarchy(
        np.hstack([x_rows / problem.weight, own_slack]),
        lower - shift,
        upper - shift,
        sizes,
        lo=np.append((problem.lo - problem.ref) * problem.weight, -free),
        hi=np.append((problem.hi - problem.ref) * problem.weight, free),
        still=np.append(-problem.ref * problem.weight, np.zeros(slacks)),
        damping=damping,
    )
    x = np.clip(problem.ref + z[: problem.nv] / problem.weight, problem.lo, problem.hi)
    return Answer(x, reduced, capped)


@dataclass(frozen=True)
class Comparison:
    """What was found about one answer; `fault` is empty when it is right."""

    fault: str
    oracle_worse: bool


def compare(problem: Hierarchy, x: Array) -> Comparison:
    """Hold x to the box, to the optimality conditions, and level by level to the oracle."""
    if not np.all(np.isfinite(x)) or outside_box(problem, x) != 0.0:
        return Comparison(f"{problem.name}: not finite or {outside_box(problem, x):.1e} outside the box", False)
    best = solve_cascade(problem)
    size = 1.0 + np.maximum(problem.sizes(x), problem.sizes(best))
    excess = (problem.residuals(x) - problem.residuals(best)) / size
    differs = np.flatnonzero(np.abs(excess) > EQUAL)
    unexplained = optimality(problem, x)
    if len(differs) and excess[differs[0]] > 0.0:
        return Comparison(
            f"{problem.name}: level {differs[0]} worse than the oracle by {excess[differs[0]]:.1e}", False
        )
    if unexplained.max() > OPTIMAL:
        return Comparison(f"{problem.name}: level {unexplained.argmax()} not optimal by {unexplained.max():.1e}", False)
    return Comparison("", len(differs) > 0)
