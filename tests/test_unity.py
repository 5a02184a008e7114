"""Unity's axes: the table of the facts, reflections, and Euler angles against their definition."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from retarget import rotations
from retarget.rotations import FloatArray
from retarget.sources.unity import euler_from_unity, poses_from_unity, position_from_unity

ANGLES = st.floats(-720.0, 720.0)


def about(axis: int, degrees: float) -> FloatArray:
    """Quaternion xyzw about one of Unity's axes."""
    out = np.zeros(4)
    out[axis], out[3] = np.sin(np.radians(degrees) / 2), np.cos(np.radians(degrees) / 2)
    return out


def turn(quaternion: FloatArray) -> FloatArray:
    """One quaternion xyzw of Unity as wxyz in the world's axes."""
    return poses_from_unity(np.concatenate((np.zeros(3), quaternion)))[1]


def test_axes() -> None:
    assert_allclose(position_from_unity([1.0, 2.0, 3.0]), [3.0, -1.0, 2.0])
    position, orientation = poses_from_unity(np.array([[1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 0.9]] * 2))
    assert_allclose(position, [[3.0, -1.0, 2.0]] * 2)
    assert_allclose(orientation, [[0.9, -0.3, 0.1, -0.2]] * 2)


def test_signs_a_person_can_check() -> None:
    """In Unity, turning right is positive about y, looking down about x, leaning left about z."""
    x, y, z = np.eye(3)
    assert_allclose(rotations.rotate(euler_from_unity([0.0, 90.0, 0.0]), x), -y, atol=1e-12)
    assert_allclose(rotations.rotate(euler_from_unity([90.0, 0.0, 0.0]), x), -z, atol=1e-12)
    assert_allclose(rotations.rotate(euler_from_unity([0.0, 0.0, 90.0]), z), y, atol=1e-12)


@settings(max_examples=100)
@given(ANGLES, ANGLES, ANGLES)
def test_euler_angles_turn_by_z_then_x_then_y(x: float, y: float, z: float) -> None:
    one = [turn(about(axis, angle)) for axis, angle in ((1, y), (0, x), (2, z))]
    whole = rotations.multiply(rotations.multiply(one[0], one[1]), one[2])
    assert_allclose(euler_from_unity([x, y, z]), whole, atol=1e-12)
    assert_allclose(euler_from_unity([[x, y, z]] * 2), [whole] * 2, atol=1e-12)


@settings(max_examples=100)
@given(st.lists(st.floats(-1.0, 1.0), min_size=7, max_size=7))
def test_turning_and_converting_may_change_places(numbers: list[float]) -> None:
    """A left-handed turn of a point, converted, is the converted turn of the converted point."""
    point, q = np.array(numbers[:3]), rotations.normalise([*numbers[3:6], 2.0 + numbers[6]])
    turned = rotations.rotate(q[[3, 0, 1, 2]], point)  # the formula is the same in both kinds of axes
    there = rotations.rotate(turn(q), position_from_unity(point))
    assert_allclose(position_from_unity(turned), there, atol=1e-12)
