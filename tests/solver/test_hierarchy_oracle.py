"""The solver's hierarchy against a cascade of quadratic programs, on random hierarchies of every difficulty we know.

A failure prints the names of the hierarchies; `random_hierarchy(seed)` in `oracles/hierarchies.py` makes each again.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hierarchy_oracle_helpers import EQUAL, compare, solve
from oracles.cascade import solve_cascade
from oracles.hierarchies import CHANGES, ROUGH_CHANGES, Change, random_hierarchy
from oracles.optimality import optimality, outside_box
from oracles.problem import Array, Hierarchy, Level
from oracles.textbook import prioritized_pseudo_inverse

STRICT = 1e-9  # change of a residual by the levels below

BLOCK = 25
SHORT_BLOCKS = range(0, 200, BLOCK)
LONG_BLOCKS = range(10_000, 21_000, 20 * BLOCK)
ROUGH_BLOCKS = range(50_000, 50_100, BLOCK)


def assert_right(seeds: range, changes: tuple[Change, ...] = CHANGES) -> None:
    """Every seed's answer is right, and the oracle itself is nearly always the best answer known."""
    problems = [random_hierarchy(seed, changes) for seed in seeds]
    found = [compare(problem, solve(problem).x) for problem in problems]
    faults = [comparison.fault for comparison in found if comparison.fault]
    assert not faults, "\n".join(faults)
    assert sum(comparison.oracle_worse for comparison in found) <= 1 + len(seeds) // 100


@pytest.mark.parametrize("start", SHORT_BLOCKS)
def test_residuals_equal_the_oracle(start: int) -> None:
    assert_right(range(start, start + BLOCK))


@pytest.mark.long
@pytest.mark.parametrize("start", LONG_BLOCKS)
def test_residuals_equal_the_oracle_long(start: int) -> None:
    assert_right(range(start, start + 20 * BLOCK))


@pytest.mark.parametrize("start", ROUGH_BLOCKS)
def test_near_singular_levels_without_damping(start: int) -> None:
    assert_right(range(start, start + BLOCK), ROUGH_CHANGES)


@pytest.mark.parametrize("damping", [0.0, 0.05, 1.0])
@pytest.mark.parametrize("start", SHORT_BLOCKS)
def test_lower_levels_change_nothing_above(start: int, damping: float) -> None:
    faults = []
    for seed in range(start, start + BLOCK):
        problem = random_hierarchy(seed)
        whole = solve(problem, damping).x
        for count in range(1, len(problem.levels)):
            alone = solve(problem.first(count), damping).x
            change = np.abs(problem.residuals(whole)[:count] - problem.residuals(alone)[:count])
            share = change / np.maximum(1.0, problem.sizes(alone)[:count])
            if share.max() > STRICT:
                faults.append(f"{problem.name}: level {share.argmax()} moved by {share.max():.1e} below {count}")
    assert not faults, "\n".join(faults)


def test_same_input_same_bits() -> None:
    for seed in range(100):
        problem = random_hierarchy(seed, ROUGH_CHANGES)
        assert solve(problem).x.tobytes() == solve(problem).x.tobytes(), problem.name


def test_no_answer_is_given_up() -> None:
    assert not [seed for seed in range(400) if solve(random_hierarchy(seed)).capped]


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_the_unit_of_a_level_does_not_matter(scale: float) -> None:
    for seed in range(100):
        problem = random_hierarchy(seed, CHANGES[:-1])
        levels = tuple(
            Level(scale * level.C, scale * level.e, scale * level.D, scale * level.lower, scale * level.upper)
            for level in problem.levels
        )
        assert solve(replace(problem, levels=levels)).x == pytest.approx(solve(problem).x, abs=EQUAL), problem.name


@pytest.mark.parametrize("scale", [1e-4, 1e4])
def test_the_unit_of_the_answer_does_not_matter(scale: float) -> None:
    for seed in range(100):
        problem = random_hierarchy(seed, CHANGES[:-1])
        levels = tuple(
            Level(level.C, scale * level.e, level.D, scale * level.lower, scale * level.upper)
            for level in problem.levels
        )
        soft = None if problem.soft is None else (problem.soft[0], scale * problem.soft[1])
        stretched = replace(
            problem, levels=levels, lo=scale * problem.lo, hi=scale * problem.hi, ref=scale * problem.ref, soft=soft
        )
        assert solve(stretched).x / scale == pytest.approx(solve(problem).x, abs=EQUAL), problem.name


@pytest.mark.parametrize("seed", range(40))
def test_the_textbook_where_no_bound_matters(seed: int) -> None:
    problem = random_hierarchy(seed, CHANGES[:4], share=0.5)
    wide = replace(problem, lo=problem.lo - 1e4, hi=problem.hi + 1e4)
    levels = [(level.C, level.e) for level in problem.levels]
    assert solve(wide).x == pytest.approx(prioritized_pseudo_inverse(levels, problem.weight, problem.ref), abs=1e-7)


numbers = st.sampled_from([0.0, 1.0, -1.0, 0.5, -2.0, 1e-9, -1e-9, 1e-5, 3e3, -1e6, 1e9])


@st.composite
def ugly_hierarchies(draw: st.DrawFn) -> Hierarchy:
    """Small hierarchies of ugly numbers: zero and equal rows, empty levels, fixed columns, no bounds, wild scales."""
    nv = draw(st.integers(1, 5))

    def matrix(rows: int) -> Array:
        return np.array(draw(st.lists(numbers, min_size=rows * nv, max_size=rows * nv))).reshape(rows, nv)

    def vector(size: int) -> Array:
        return np.array(draw(st.lists(numbers, min_size=size, max_size=size)), dtype=np.float64)

    levels = []
    for _ in range(draw(st.integers(1, 4))):
        m, k = draw(st.integers(0, 4)), draw(st.integers(0, 3))
        a, b = vector(k), vector(k)
        lower = np.where(draw(st.booleans()), np.minimum(a, b), -np.inf)
        upper = np.where(draw(st.booleans()), np.maximum(a, b), np.inf)
        levels.append(Level.of(matrix(m), vector(m), matrix(k), np.broadcast_to(lower, k), np.broadcast_to(upper, k)))
    a, b = vector(nv), vector(nv)
    weight = np.array(draw(st.lists(st.sampled_from([0.1, 1.0, 20.0]), min_size=nv, max_size=nv)))
    return Hierarchy(tuple(levels), np.minimum(a, b), np.maximum(a, b), weight, vector(nv))


@given(ugly_hierarchies())
def test_any_hierarchy_has_a_finite_answer_inside_the_box(problem: Hierarchy) -> None:
    result = solve(problem)
    assert np.all(np.isfinite(result.x))
    assert outside_box(problem, result.x) == 0.0
    assert solve(problem).x.tobytes() == result.x.tobytes()


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_any_seed_is_right(seed: int) -> None:
    comparison = compare(problem := random_hierarchy(seed), solve(problem).x)
    assert not comparison.fault


# The references themselves: they agree with each other, with answers known by hand, and notice wrong answers.


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
