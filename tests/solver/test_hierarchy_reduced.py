"""Hierarchies solved in the space that planted soles leave: right where it holds the answer, else left alone."""

from dataclasses import replace

import numpy as np
import pytest

from hierarchy_oracle_helpers import Answer, compare, solve
from oracles.problem import Hierarchy, Level

SEEDS = range(15)


def planted(seed: int, *, rows: int = 10, room: float = 1.0) -> Hierarchy:
    """Limits, then equalities that some x inside the box meets, then limits, then far goals; in a narrow box."""
    rng = np.random.default_rng(seed)
    nv = 22
    half = rng.uniform(0.02, 0.3, nv)
    inside = rng.uniform(-0.9, 0.9, nv) * half
    soles = rng.normal(size=(rows, nv))
    near, balance = rng.normal(size=(4, nv)), rng.normal(size=(3, nv))
    none = np.zeros((0, nv))
    free, far = np.full(4, np.inf), rng.normal(size=9) * 3.0
    levels = (
        Level.of(none, np.zeros(0), near, near @ inside - rng.uniform(0.0, 0.1, 4) * room, free),
        Level.of(soles, soles @ inside),
        Level.of(none, np.zeros(0), balance, balance @ inside - 0.05, balance @ inside + 0.05),
        Level.of(rng.normal(size=(9, nv)), far),
        Level.of(rng.normal(size=(2, nv)), rng.normal(size=2)),
    )
    return Hierarchy(levels, -half, half, rng.uniform(0.3, 2.0, nv), rng.normal(size=nv) * 0.3, name=f"planted {seed}")


def assert_right(problems: list[Hierarchy]) -> list[Answer]:
    """Every answer is the oracle's."""
    answers = [solve(problem) for problem in problems]
    faults = [compare(problem, answer.x).fault for problem, answer in zip(problems, answers, strict=True)]
    assert not any(faults), "\n".join(filter(None, faults))
    return answers


@pytest.mark.parametrize("rows", [6, 10, 14])
def test_it_is_the_oracles_answer(rows: int) -> None:
    answers = assert_right([planted(seed, rows=rows) for seed in SEEDS])
    assert np.mean([answer.reduced for answer in answers]) > 0.9


def test_equalities_that_depend_on_each_other() -> None:
    def twice(problem: Hierarchy, contradiction: float) -> Hierarchy:
        soles = problem.levels[1]
        again = replace(soles, C=np.vstack([soles.C, soles.C[:4]]), e=np.append(soles.e, soles.e[:4] + contradiction))
        return replace(problem, levels=(problem.levels[0], again, *problem.levels[2:]))

    answers = assert_right([twice(planted(seed), contradiction) for seed in SEEDS for contradiction in (0.0, 0.01)])
    assert any(answer.reduced for answer in answers)


def test_equalities_that_the_box_does_not_allow_are_left_to_the_whole_problem() -> None:
    def out_of_reach(problem: Hierarchy) -> Hierarchy:
        soles = replace(problem.levels[1], e=problem.levels[1].e + 5.0)
        return replace(problem, levels=(problem.levels[0], soles, *problem.levels[2:]))

    answers = assert_right([out_of_reach(planted(seed)) for seed in SEEDS])
    assert not any(answer.reduced for answer in answers)


def test_limits_above_that_the_equalities_break_are_left_to_the_whole_problem() -> None:
    def broken(problem: Hierarchy) -> Hierarchy:
        above = problem.levels[0]
        pushed = replace(above, D=problem.levels[1].C[:1], lower=problem.levels[1].e[:1] + 0.01, upper=above.upper[:1])
        return replace(problem, levels=(pushed, *problem.levels[1:]))

    answers = assert_right([broken(planted(seed)) for seed in SEEDS])
    assert not any(answer.reduced for answer in answers)


def test_columns_that_cannot_move_and_columns_that_follow() -> None:
    def stiff(problem: Hierarchy, seed: int) -> Hierarchy:
        soles = problem.levels[1]
        inside = np.linalg.lstsq(soles.C, soles.e, rcond=None)[0]
        still = np.arange(problem.nv) % 7 == seed % 7
        lo, hi = np.where(still, inside, problem.lo), np.where(still, inside, problem.hi)
        alone = np.zeros((1, problem.nv))
        alone[0, (seed + 1) % problem.nv] = 1.0  # one column is fixed by a row of its own
        soles = replace(soles, C=np.vstack([soles.C, alone]), e=np.append(soles.e, alone @ inside))
        lo, hi = np.minimum(lo, inside - ~still * 1e-3), np.maximum(hi, inside + ~still * 1e-3)
        return replace(problem, lo=lo, hi=hi, levels=(problem.levels[0], soles, *problem.levels[2:]))

    answers = assert_right([stiff(planted(seed, room=10.0), seed) for seed in SEEDS])
    assert any(answer.reduced for answer in answers)
