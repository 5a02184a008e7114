"""The least-squares search, beside SciPy's and by the conditions of a minimum."""

import numpy as np
import pytest
from scipy.optimize import least_squares as scipys

from retarget.ik.least_squares import least_squares
from retarget.types import FloatArray


def rosenbrock(x: FloatArray) -> FloatArray:
    return np.concatenate([10.0 * (x[1:] - x[:-1] * x[:-1]), 1.0 - x[:-1]])


def chain(x: FloatArray) -> FloatArray:
    """The end of an arm of four links goes to a place that it reaches in many ways, its angles near zero."""
    angles = np.cumsum(x)
    end = np.array([np.cos(angles).sum(), np.sin(angles).sum()])
    return np.concatenate([end - [1.5, 2.0], 0.01 * x])


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize(("residual", "count"), [(rosenbrock, 2), (rosenbrock, 5), (chain, 4)])
def test_scipy_finds_nothing_better_nearby(residual: object, count: int, seed: int) -> None:
    assert callable(residual)
    found = least_squares(residual, np.random.default_rng(seed).uniform(-1.0, 1.0, size=count))
    theirs = scipys(residual, found, xtol=1e-12, ftol=1e-12, gtol=1e-12)
    np.testing.assert_allclose(np.square(residual(found)).sum(), 2.0 * theirs.cost, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_in_a_box_nothing_beside_it_is_better(seed: int) -> None:
    random = np.random.default_rng(seed)
    matrix, goal = random.normal(size=(9, 6)), random.normal(size=9)
    low, high = -random.uniform(0.0, 0.3, size=6), random.uniform(0.0, 0.3, size=6)
    found = least_squares(lambda x: matrix @ x - goal, random.uniform(-2.0, 2.0, size=6), lower=low, upper=high)
    assert (found >= low).all() and (found <= high).all()
    slope = matrix.T @ (matrix @ found - goal)  # of half the sum of squares; at a minimum it points out of the box
    least, most = found < low + 1e-12, found > high - 1e-12
    assert np.abs(slope[~(least | most)]).max(initial=0.0) < 1e-6
    assert (slope[least] > -1e-6).all() and (slope[most] < 1e-6).all()


def test_a_start_outside_the_box_or_at_the_minimum_is_none_too_many() -> None:
    box = np.array([1.0, 1.0])
    assert least_squares(lambda x: x, np.array([5.0, 5.0]), lower=box, upper=2.0 * box).tolist() == [1.0, 1.0]
    assert least_squares(lambda x: x - 1.0, box).tolist() == [1.0, 1.0]


def test_it_ends_after_so_many_steps() -> None:
    calls = list[FloatArray]()

    def residual(x: FloatArray) -> FloatArray:
        calls.append(x)
        return np.array([np.exp(-x[0])])  # falls for ever

    least_squares(residual, np.zeros(1), most_steps=7)
    assert len(calls) <= 2 * (1 + 7)
