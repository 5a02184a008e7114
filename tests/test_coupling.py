"""Couplings by themselves."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware.coupling import MAX_CONDITION, Coupling

Matrix = tuple[tuple[float, float], tuple[float, float]]
numbers = st.floats(-10.0, 10.0)
matrices = st.tuples(st.tuples(numbers, numbers), st.tuples(numbers, numbers))


@given(matrices)
def test_condition_is_the_ratio_of_the_singular_values(matrix: Matrix) -> None:
    coupling = Coupling(("a", "b"), matrix)
    largest, smallest = np.linalg.svd(np.array(matrix), compute_uv=False)
    if largest > 1e-3 and smallest > 1e-4 * largest:
        assert coupling.condition == pytest.approx(largest / smallest, rel=1e-6)
    elif largest > 1e-3:
        assert coupling.condition > 9e3 and coupling.problems()


@given(matrices)
def test_the_inverse_of_a_sound_coupling_undoes_it(matrix: Matrix) -> None:
    coupling = Coupling(("a", "b"), matrix)
    if not coupling.problems():
        np.testing.assert_allclose(np.array(coupling.inverse) @ np.array(matrix), np.eye(2), atol=1e-9 * MAX_CONDITION)


@pytest.mark.parametrize(
    ("joints", "matrix", "text"),
    [
        (("a", "a"), ((1.0, 0.0), (0.0, 1.0)), "two different joints"),
        (("a", "b"), ((1.0, 2.0), (2.0, 4.0)), "singular"),
        (("a", "b"), ((0.0, 0.0), (0.0, 0.0)), "singular"),
        (("a", "b"), ((1.0, 1.0), (1.0, 1.0001)), "singular or nearly so"),
        (("a", "b"), ((1.0, math.nan), (0.0, 1.0)), "not finite"),
        (("a", "b"), ((1e200, 0.0), (0.0, 1e200)), "singular"),
    ],
)
def test_each_problem_is_found(joints: tuple[str, str], matrix: Matrix, text: str) -> None:
    (problem,) = Coupling(joints, matrix).problems()
    assert text in problem
