"""The parametric person at rest: zero is average, each parameter does one thing."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import ArrayLike

from retarget import rest_body
from retarget.human_dimensions import POINTS, proportional_dimensions
from retarget.rotations import FloatArray


def parameters(**values: ArrayLike) -> FloatArray:
    result = np.zeros(rest_body.COUNT)
    result[rest_body.STATURE] = np.log(1.7)
    for name, value in values.items():
        result[getattr(rest_body, name)] = value
    return result


def test_zero_is_an_average_person_standing() -> None:
    usual = proportional_dimensions(1.7)
    assert_allclose(rest_body.offsets(parameters()), usual.offset, atol=1e-12)
    assert_allclose(rest_body.points(parameters()), usual.standing(), atol=1e-12)
    assert_allclose(rest_body.prior(parameters(), np.ones(4)), 0.0)


@pytest.mark.parametrize(
    ("proportion", "longer"),
    [(0, "chest"), (1, "head"), (2, "l_elbow"), (3, "r_wrist"), (4, "l_knee"), (5, "r_ankle")],
)
def test_a_proportion_stretches_its_segment_alone(proportion: int, longer: str) -> None:
    stretched = np.zeros(7)
    stretched[proportion] = 0.1
    ratio = np.linalg.norm(rest_body.offsets(parameters(PROPORTIONS=stretched)), axis=1)[1:]
    ratio /= np.linalg.norm(rest_body.offsets(parameters()), axis=1)[1:]
    assert ratio[POINTS.index(longer) - 1] == pytest.approx(np.exp(0.1))
    others = [name for name in ("chest", "head", "l_elbow", "r_wrist", "l_knee", "r_ankle") if name != longer]
    assert all(ratio[POINTS.index(name) - 1] == pytest.approx(1.0) for name in others)


def test_breadth_moves_hips_and_shoulders_apart() -> None:
    wide = rest_body.offsets(parameters(PROPORTIONS=[0, 0, 0, 0, 0, 0, 0.1]))
    usual = rest_body.offsets(parameters())
    for name in ("l_hip", "r_shoulder"):
        i = POINTS.index(name)
        assert_allclose(wide[i], usual[i] * [1.0, np.exp(0.1), 1.0])


def test_limbs_point_where_their_angles_say() -> None:
    angles = np.zeros((4, 2, 2))
    angles[0, :, 0] = np.pi / 2  # left arm straight out
    angles[1, 1, 1] = np.pi / 2  # right forearm forward
    points = dict(zip(POINTS, rest_body.points(parameters(ANGLES=angles.ravel())), strict=True))
    usual = proportional_dimensions(1.7)
    reach = usual.length("l_elbow") + usual.length("l_wrist") + usual.length("l_hand")
    assert_allclose(points["l_hand"] - points["l_shoulder"], [0.0, reach, 0.0], atol=1e-12)
    assert_allclose(points["r_wrist"] - points["r_elbow"], [usual.length("r_wrist"), 0.0, 0.0], atol=1e-12)


def test_heading_and_root_move_the_whole_person() -> None:
    moved = rest_body.points(parameters(HEADING=np.pi / 2, ROOT=[1.0, 2.0, 3.0]))
    quarter_turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    usual = rest_body.points(parameters()) @ quarter_turn.T
    assert_allclose(moved, usual + np.array([1.0, 2.0, 3.0]), atol=1e-12)
