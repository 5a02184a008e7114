"""The enclosing box finds a turned box again and holds balls."""

import numpy as np
import pytest

from retarget.fitting.box import MIN_HALF, enclosing_box
from retarget.fitting.geometry import LinkGeometry
from retarget.rotations import FloatArray, from_axis_angle, to_matrix

CORNERS = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T


def geometry(centres: FloatArray, radii: FloatArray, turn: FloatArray) -> LinkGeometry:
    return LinkGeometry(1, "link", centres, radii, turn[None], None)


def test_a_turned_box_is_found_again() -> None:
    turn = to_matrix(from_axis_angle([0.6, 0.0, 0.8], 0.7))
    half = np.array([0.1, 0.2, 0.3])
    box = enclosing_box(geometry((CORNERS * half) @ turn.T + [1.0, 0.0, 0.0], np.zeros(8), turn))
    assert box.volume == pytest.approx(8.0 * half.prod())
    assert box.pos == pytest.approx([1.0, 0.0, 0.0])
    assert to_matrix(box.quat) == pytest.approx(turn)


def test_balls_count_with_their_radius() -> None:
    centres = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    box = enclosing_box(geometry(centres, np.array([0.1, 0.2]), np.eye(3)))
    assert box.size == pytest.approx([0.65, 0.2, 0.2])
    assert box.pos == pytest.approx([0.55, 0.0, 0.0])


def test_flat_geometry_gets_some_thickness() -> None:
    box = enclosing_box(geometry(CORNERS * [1.0, 1.0, 0.0], np.zeros(8), np.eye(3)))
    assert box.size[2] == MIN_HALF
