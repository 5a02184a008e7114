"""The references themselves: they agree with each other, with answers known by hand, and notice wrong answers."""

import numpy as np
import pytest

from oracles.cascade import solve_cascade
from oracles.hierarchies import random_hierarchy
from oracles.optimality import optimality, outside_box
from oracles.problem import Hierarchy, Level


def small(*levels: Level, reach: float = 1.0, nv: int = 2) -> Hierarchy:
    """Levels over `nv` variables in a box of half width `reach`, unit weights, reference zero."""
    return Hierarchy(levels, np.full(nv, -reach), np.full(nv, reach), np.ones(nv), np.zeros(nv))


def test_a_joint_that_clamping_would_keep_is_released() -> None:
    # Unconstrained level 1 leaves x0 = 3 beyond its bound; clamped there, level 2 pulls it back inside.
    top = Level.of(np.array([[1.0, 1.0]]), np.array([2.0]))
    below = Level.of(np.array([[1.0, -1.0]]), np.array([-1.0]))
    problem = small(top, below, reach=2.0)
    assert solve_cascade(problem) == pytest.approx([0.5, 1.5], abs=1e-10)


@pytest.mark.parametrize("seed", range(40))
def test_cascade_is_optimal_and_inside(seed: int) -> None:
    problem = random_hierarchy(seed)
    x = solve_cascade(problem)
    assert outside_box(problem, x) == 0.0
    assert optimality(problem, x).max() < 1e-8, problem.name


def test_optimality_notices_small_errors() -> None:
    rng = np.random.default_rng(3)
    noticed = []
    for seed in range(30):
        problem = random_hierarchy(seed)
        if np.any(problem.hi - problem.lo < 1e-3):
            continue
        x = solve_cascade(problem)
        moved = np.clip(x + 1e-4 * rng.normal(size=problem.nv), problem.lo, problem.hi)
        noticed.append(optimality(problem, moved).max() > 1e-7)
    assert all(noticed)
