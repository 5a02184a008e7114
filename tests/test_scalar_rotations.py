"""Rotations on tuples agree with those on arrays."""

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from retarget import rotations
from retarget.scalar_rotations import (
    Quat,
    Vector,
    arc,
    axis_turn,
    inverse,
    minus,
    plus,
    product,
    rotated,
    rotation_vector,
    turn,
)

NUMBERS = st.floats(-2.0, 2.0)
VECTORS = st.tuples(NUMBERS, NUMBERS, NUMBERS)
TURNS = VECTORS.map(turn)


@given(TURNS, TURNS, VECTORS)
def test_they_agree_with_arrays(a: Quat, b: Quat, v: Vector) -> None:
    assert np.allclose(product(a, b), rotations.multiply(a, b))
    assert np.allclose(rotated(a, v), rotations.rotate(a, v))
    assert np.allclose(rotation_vector(a), rotations.log(a), atol=1e-9)
    assert np.allclose(inverse(a), rotations.conjugate(a))
    assert np.allclose(plus(minus(v, (1.0, 2.0, 3.0)), (1.0, 2.0, 3.0)), v)


@given(VECTORS)
def test_turn_and_rotation_vector_undo_each_other(v: Vector) -> None:
    assume(np.linalg.norm(v) < 3.1)
    assert np.allclose(rotation_vector(turn(v)), v, atol=1e-9)
    assert np.allclose(turn(v), rotations.from_rotation_vector(v), atol=1e-12)


@given(VECTORS, VECTORS)
def test_an_arc_takes_one_direction_to_the_other(a: Vector, b: Vector) -> None:
    assume(np.linalg.norm(a) > 1e-2 and np.linalg.norm(b) > 1e-2)
    moved = np.array(rotated(arc(a, b), a))
    assert np.allclose(moved / np.linalg.norm(a), np.array(b) / np.linalg.norm(b), atol=1e-5)


def test_opposite_directions_have_an_arc_too() -> None:
    for a in ((0.0, 0.0, 2.0), (1.0, 0.0, 0.0), (0.3, -0.4, 0.5)):
        back = (-a[0], -a[1], -a[2])
        assert np.allclose(rotated(arc(a, back), a), back, atol=1e-6)


def test_a_turn_about_an_axis() -> None:
    assert np.allclose(rotated(axis_turn((0.0, 0.0, 1.0), np.pi / 2.0), (1.0, 0.0, 0.0)), (0.0, 1.0, 0.0))
