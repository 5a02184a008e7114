"""One answer of the solver, held to the box, to optimality, and level by level to the oracle."""

from dataclasses import dataclass

import numpy as np

from oracles.cascade import solve_cascade
from oracles.optimality import optimality, outside_box
from oracles.problem import Array, Hierarchy
from retarget import _solver

EQUAL = 1e-6  # residual of a level against the oracle's
OPTIMAL = 1e-7  # unexplained share of a level's gradient


def solve(problem: Hierarchy, damping: float = 0.0) -> _solver.HierarchyResult:
    """One linear solve by the code under test; every level is damped alike."""
    return _solver.solve_hierarchy(
        problem.tuples(),
        problem.lo,
        problem.hi,
        weight=problem.weight,
        reference=problem.ref,
        soft=problem.soft,
        damping=damping,
    )


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
