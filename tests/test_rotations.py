"""Quaternion functions against SciPy and against their own inverses."""

import itertools

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from messages import refuses
from retarget import rotations
from retarget.rotations import (
    Quat,
    Vector,
    arc,
    inverse,
    minus,
    plus,
    product,
    rotated,
    rotation_vector,
    turn,
)
from retarget.types import FloatArray


def random_quaternions(count: int, seed: int = 0) -> FloatArray:
    q = np.random.default_rng(seed).normal(size=(count, 4))
    return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))


def as_scipy(q: FloatArray) -> Rotation:
    return Rotation.from_quat(np.roll(q, -1, axis=-1))


def assert_same_rotation(a: FloatArray, b: FloatArray, tolerance: float = 1e-12) -> None:
    assert np.max(np.abs(np.abs(np.sum(a * b, axis=-1)) - 1.0)) < tolerance


def test_multiply_and_rotate_agree_with_scipy() -> None:
    a, b = random_quaternions(50), random_quaternions(50, seed=1)
    v = np.random.default_rng(2).normal(size=(50, 3))
    assert_same_rotation(
        rotations.multiply(a, b),
        np.roll((as_scipy(a) * as_scipy(b)).as_quat(), 1, axis=-1),
    )
    np.testing.assert_allclose(rotations.rotate(a, v), as_scipy(a).apply(v), atol=1e-14)


def test_conjugate_is_the_inverse() -> None:
    q = random_quaternions(20)
    assert_same_rotation(
        rotations.multiply(q, rotations.conjugate(q)),
        np.broadcast_to(rotations.IDENTITY, q.shape),
    )


def test_matrix_round_trip_covers_every_pivot() -> None:
    half_turns = np.array([[0.0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [1, 0, 0, 0]])
    q = np.concatenate([random_quaternions(200), half_turns])
    matrix = rotations.to_matrix(q)
    np.testing.assert_allclose(matrix, as_scipy(q).as_matrix(), atol=1e-14)
    assert_same_rotation(rotations.from_matrix(matrix), q)


def test_log_is_the_inverse_of_the_exponential_map() -> None:
    vectors = np.random.default_rng(3).normal(size=(100, 3))
    vectors *= np.linspace(0.0, np.pi - 1e-6, 100)[:, None] / np.linalg.norm(vectors, axis=1, keepdims=True)
    vectors = np.concatenate([vectors, [[1e-12, 0, 0], [0, 1e-9, 0]]])
    q = rotations.from_rotation_vector(vectors)
    np.testing.assert_allclose(rotations.log(q), vectors, atol=1e-9)
    np.testing.assert_allclose(rotations.log(-q), vectors, atol=1e-9)


def test_axis_angle_is_the_exponential_of_axis_times_angle() -> None:
    axis = np.array([0.6, 0.0, 0.8])
    angles = np.linspace(-3, 3, 7)
    np.testing.assert_allclose(
        rotations.from_axis_angle(axis, angles),
        rotations.from_rotation_vector(angles[:, None] * axis),
        atol=1e-15,
    )


@pytest.mark.parametrize("axes", ["".join(p) for n in (1, 2, 3) for p in itertools.permutations("xyz", n)])
def test_euler_of_any_order_agrees_with_scipy(axes: str) -> None:
    angles = np.random.default_rng(4).uniform(-3, 3, size=(30, len(axes)))
    expected = Rotation.from_euler(axes.upper(), angles)
    assert_same_rotation(rotations.from_euler(angles, axes), np.roll(expected.as_quat(), 1, axis=-1))
    assert_same_rotation(
        rotations.from_euler(angles, axes.upper()),
        np.roll(expected.as_quat(), 1, axis=-1),
    )


@pytest.mark.parametrize("axes", ["".join(p) for p in itertools.permutations("xyz")])
def test_euler_round_trip_with_gimbal_lock(axes: str) -> None:
    q = random_quaternions(100)
    locked = rotations.from_euler(np.array([[0.3, np.pi / 2, 0.7], [-2.0, -np.pi / 2, 0.1]]), axes)
    both = np.concatenate([q, locked])
    assert_same_rotation(rotations.from_euler(rotations.to_euler(both, axes), axes), both, tolerance=1e-9)


def test_slerp_goes_the_short_way_at_constant_speed() -> None:
    a, b = random_quaternions(40), random_quaternions(40, seed=5)
    angle = rotations.angle_between(a, b)
    for share in (0.0, 0.25, 0.5, 1.0):
        middle = rotations.slerp(a, b, np.full(40, share))
        np.testing.assert_allclose(rotations.angle_between(a, middle), share * angle, atol=1e-7)
        assert_same_rotation(middle, rotations.slerp(a, -b, np.full(40, share)))


def test_shortest_arc_turns_one_direction_into_the_other() -> None:
    generator = np.random.default_rng(6)
    a, b = generator.normal(size=(30, 3)), generator.normal(size=(30, 3))
    b[0] = -2.0 * a[0]
    b[1] = 3.0 * a[1]
    turned = rotations.rotate(rotations.shortest_arc(a, b), a / np.linalg.norm(a, axis=1, keepdims=True))
    np.testing.assert_allclose(turned, b / np.linalg.norm(b, axis=1, keepdims=True), atol=1e-7)


def test_nan_stays_nan_and_raises_nothing() -> None:
    q = np.full((2, 4), np.nan)
    assert np.isnan(rotations.slerp(q, q, np.array([0.1, 0.2]))).all()
    assert np.isnan(rotations.normalise(np.zeros(4))).all()


def test_wrong_axes_are_refused() -> None:
    with refuses(ValueError):
        rotations.from_euler([1.0], "w")
    with refuses(ValueError):
        rotations.from_euler([1.0], "xy")
    with refuses(ValueError):
        rotations.to_euler(rotations.IDENTITY, "xyx")


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


@given(st.integers(0, 2**32 - 1))
def test_the_best_turn_is_the_one_that_points_were_turned_by(seed: int) -> None:
    """Upside down too, and with noise nearly so."""
    rng = np.random.default_rng(seed)
    points, turn = rng.standard_normal((5, 3)), rotations.normalise(rng.standard_normal(4))
    goals = rotations.rotate(turn, points) + rng.standard_normal(3)
    assert rotations.angle_between(rotations.best_turn(points, goals), turn) < 1e-6
    half = np.array([0.0, 0.0, 1.0, 0.0])
    assert rotations.angle_between(rotations.best_turn(points, rotations.rotate(half, points)), half) < 1e-6
