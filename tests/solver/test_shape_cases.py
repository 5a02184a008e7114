"""Solids by hand: touching, crossing, parallel, concentric; nothing and plates; what the binding refuses."""

from itertools import product

import numpy as np
import pytest

from messages import Facts, refuses
from oracles.problem import Array
from oracles.solids import BOX, CAPSULE, CYLINDER, HALF_SPACE, NAMES, Solids, nearest, one, random_solids, together
from retarget import _solver

KINDS = [(k, m) for k, m in product(range(4), repeat=2) if (k, m) != (HALF_SPACE, HALF_SPACE)]


def meets(a: Solids, b: Solids) -> tuple[float, Array, Array, Array]:
    distance, point_a, point_b, normal = nearest(a, b)
    return float(distance[0]), point_a[0], point_b[0], normal[0]


X_AXIS, Y_AXIS = (0.0, 90.0, 0.0), (-90.0, 0.0, 0.0)


def test_concentric_balls() -> None:
    distance, _, _, normal = meets(one(CAPSULE, (0.2, 0.0)), one(CAPSULE, (0.3, 0.0)))
    assert distance == pytest.approx(-0.5)
    assert np.linalg.norm(normal) == pytest.approx(1.0)


def test_crossing_lines_take_their_common_perpendicular() -> None:
    for height in (0.0, 1e-16, -1e-12, 1e-9):
        distance, _, _, normal = meets(
            one(CAPSULE, (0.0, 1.0), (0, 0, height), X_AXIS), one(CAPSULE, (0.0, 1.0), (0, 0, 0), Y_AXIS)
        )
        assert distance == pytest.approx(abs(height), abs=1e-15)
        assert abs(normal[2]) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("shift", [0.0, 0.3, 1.9])
def test_coincident_lines_part_sideways(shift: float) -> None:
    distance, _, _, normal = meets(one(CAPSULE, (0.1, 1.0), (0, 0, shift)), one(CAPSULE, (0.1, 1.0)))
    assert (distance, normal[2]) == pytest.approx((-0.2, 0.0), abs=1e-12)


def test_lines_end_to_end_part_along_themselves() -> None:
    distance, _, _, normal = meets(one(CAPSULE, (0.0, 1.0), (0, 0, 1.5)), one(CAPSULE, (0.0, 0.5)))
    assert distance == pytest.approx(0.0, abs=1e-12)
    assert normal == pytest.approx([0, 0, 1])


def test_a_point_on_a_face_takes_the_face() -> None:
    for height in (0.3, 0.3 + 1e-13, 0.3 - 1e-13):
        distance, _, _, normal = meets(one(CAPSULE, (0.0, 0.0), (0.1, 0.05, height)), one(BOX, (0.5, 0.4, 0.3)))
        assert distance == pytest.approx(height - 0.3, abs=1e-15)
        assert normal == pytest.approx([0, 0, 1], abs=1e-12)


PARALLEL = {
    "capsules": (one(CAPSULE, (0.1, 1.0), (0.5, 0, 0.4)), one(CAPSULE, (0.1, 1.0)), (0.4, 0, 0.2)),
    "a capsule over a box": (one(CAPSULE, (0.1, 1.0), (0.4, 0, 0.5), X_AXIS), one(BOX, (1.0, 1.0, 0.1)), (0.2, 0, 0.4)),
    "a capsule in a box": (
        one(CAPSULE, (0.1, 1.0), (0.4, 0, 0.05), X_AXIS),
        one(BOX, (1.0, 1.0, 0.1)),
        (0.2, 0, -0.05),
    ),
    "a capsule by a cylinder": (one(CAPSULE, (0.1, 1.0), (0.5, 0, 0.4)), one(CYLINDER, (0.2, 1.0)), (0.4, 0, 0.2)),
    "a capsule on a cylinder": (
        one(CAPSULE, (0.1, 1.0), (0.4, 0, 0.5), X_AXIS),
        one(CYLINDER, (0.5, 0.1)),
        (0, 0, 0.4),
    ),
    "boxes": (one(BOX, (1.0, 1.0, 0.1), (0.4, -0.2, 0.5)), one(BOX, (1.0, 1.0, 0.1)), (0.2, -0.1, 0.4)),
    "boxes, one in the other": (
        one(BOX, (1.0, 1.0, 0.1), (0.4, -0.2, 0.15)),
        one(BOX, (1.0, 1.0, 0.1)),
        (0.2, -0.1, 0.05),
    ),
    "box edges": (one(BOX, (0.1, 0.1, 1.0), (0.5, 0.5, 0.4)), one(BOX, (0.1, 0.1, 1.0)), (0.4, 0.4, 0.2)),
    "cylinders, side by side": (one(CYLINDER, (0.1, 1.0), (0.5, 0, 0.4)), one(CYLINDER, (0.1, 1.0)), (0.4, 0, 0.2)),
    "cylinders, one on the other": (one(CYLINDER, (0.3, 0.1), (0.2, 0, 0.5)), one(CYLINDER, (0.3, 0.1)), (0.1, 0, 0.4)),
    "a cylinder on a box": (one(CYLINDER, (0.3, 0.1), (0.2, 0.1, 0.5)), one(BOX, (1.0, 1.0, 0.1)), (0.2, 0.1, 0.4)),
    "a cylinder along a box": (
        one(CYLINDER, (0.1, 1.0), (0.4, 0, 0.5), X_AXIS),
        one(BOX, (1.0, 1.0, 0.1)),
        (0.2, 0, 0.4),
    ),
    "a box over a half-space": (one(BOX, (1.0, 0.5, 0.1), (0.4, 0, 0.5)), one(HALF_SPACE, ()), (0.4, 0, 0.4)),
    "a cylinder over a half-space": (one(CYLINDER, (0.3, 0.1), (0.4, 0, 0.5)), one(HALF_SPACE, ()), (0.4, 0, 0.4)),
}


@pytest.mark.parametrize("case", PARALLEL)
def test_parallel_sides_meet_in_their_middle(case: str) -> None:
    a, b, middle = PARALLEL[case]
    assert meets(a, b)[1] == pytest.approx(middle, abs=1e-6)
    assert meets(b, a)[2] == pytest.approx(middle, abs=1e-6)


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
