"""Solids by hand: touching, crossing, parallel, concentric; nothing and plates; what the binding refuses."""

from itertools import product

import numpy as np
import pytest

from messages import Facts, refuses
from oracles.problem import Array
from oracles.solids import CAPSULE, HALF_SPACE, NAMES, Solids, nearest, one, random_solids, together
from retarget import _solver

KINDS = [(k, m) for k, m in product(range(4), repeat=2) if (k, m) != (HALF_SPACE, HALF_SPACE)]


@pytest.mark.parametrize("kinds", KINDS, ids=lambda kinds: f"{NAMES[kinds[0]]}-{NAMES[kinds[1]]}")
def test_points_lines_and_plates_have_finite_distances(kinds: tuple[int, int]) -> None:
    a, b = (random_solids(kind, 500, np.random.default_rng([14, kind])) for kind in kinds)
    nothing = [
        Solids(x.kind, x.size * np.random.default_rng(15).choice([0.0, 1.0, 1e-300, 1e6], x.size.shape), x.pos, x.quat)
        for x in (a, b)
    ]
    for far in (0.0, 1e-300, 1e-20, 1e-9, 1e6):
        found = nearest(nothing[0].moved(np.full(3, far)), nothing[1])
        assert all(np.isfinite(values).all() for values in found)
        assert np.linalg.norm(found[3], axis=1) == pytest.approx(1.0, abs=1e-12)


BAD = [
    (0, np.array([4]), 4),
    (1, np.array([[0.1, -0.1, 0.0]]), ()),
    (1, np.array([[np.nan, 0.1, 0.0]]), ()),
    (2, np.array([[0.0, np.inf, 0.0]]), ()),
    (2, np.zeros((1, 2)), ()),
    (3, np.zeros((1, 4)), ()),
    (0, np.array([0, 0]), ()),
]


@pytest.mark.parametrize("side", [0, 4])
@pytest.mark.parametrize(("field", "value", "facts"), BAD)
@pytest.mark.parametrize("function", [_solver.shape_distances, _solver.shape_gaps_at_least])
def test_bad_solids_are_refused(function, side: int, field: int, value: Array, facts: Facts) -> None:  # type: ignore[no-untyped-def]
    ball = one(CAPSULE, (0.1, 0.1))
    arguments = [*ball.arguments, *ball.arguments]
    arguments[side + field] = value
    with refuses(ValueError, facts):
        function(*arguments)


def test_column_major_arrays_are_refused() -> None:
    balls = together([one(CAPSULE, (0.1, 0.1))] * 2)
    with refuses(ValueError, "pos_a"):
        nearest(Solids(balls.kind, balls.size, np.asfortranarray(balls.pos), balls.quat), balls)


def test_two_half_spaces_and_unequal_numbers_are_refused() -> None:
    plane, ball = one(HALF_SPACE, ()), one(CAPSULE, (0.1, 0.1))
    with refuses(ValueError):
        nearest(plane, plane)
    with refuses(ValueError, "kinds_b", 1):
        nearest(together([ball, ball]), ball)
