"""Poses that no room and no rotation holds are found, and only those."""

import numpy as np
import pytest

from retarget import rotations
from retarget.sources.stream_frame import CONVENTIONS, MAX_COORDINATE, unusable
from retarget.types import FloatArray

GOOD_PLACE, GOOD_TURN = [0.5, -1.0, 1.7], [0.6, 0.0, 0.8, 0.0]


@pytest.mark.parametrize(
    ("place", "turn", "bad"),
    [
        (GOOD_PLACE, GOOD_TURN, False),
        (GOOD_PLACE, [-1.0, 0.0, 0.0, 0.0], False),
        (GOOD_PLACE, [1.019, 0.0, 0.0, 0.0], False),
        (GOOD_PLACE, [1.021, 0.0, 0.0, 0.0], True),
        (GOOD_PLACE, [0.979, 0.0, 0.0, 0.0], True),
        (GOOD_PLACE, [0.0, 0.0, 0.0, 0.0], True),
        (GOOD_PLACE, [np.nan, 0.0, 0.0, 1.0], True),
        (GOOD_PLACE, [np.inf, 0.0, 0.0, 1.0], True),
        (GOOD_PLACE, [3.4e38, 0.0, 0.0, 1.0], True),
        ([0.0, np.nan, 0.0], GOOD_TURN, True),
        ([0.0, 0.0, -np.inf], GOOD_TURN, True),
        ([0.0, MAX_COORDINATE, 0.0], GOOD_TURN, False),
        ([0.0, 1.01 * MAX_COORDINATE, 0.0], GOOD_TURN, True),
    ],
)
def test_each_pose_by_itself(place: list[float], turn: list[float], bad: bool) -> None:
    among = unusable(np.array([GOOD_PLACE, place, GOOD_PLACE]), np.array([GOOD_TURN, turn, GOOD_TURN]))
    assert among.tolist() == [False, bad, False]


def random_poses(seed: int) -> tuple[FloatArray, FloatArray]:
    generator = np.random.default_rng(seed)
    return generator.normal(size=(50, 3)), rotations.normalise(generator.normal(size=(50, 4)))


def test_the_formulas_of_the_vendors() -> None:
    points, turns = random_poses(5)
    (px, py, pz), (w, x, y, z) = points.T, turns.T
    np.testing.assert_allclose(CONVENTIONS["unity"].positions(points), np.stack([pz, -px, py], axis=1))
    np.testing.assert_allclose(CONVENTIONS["unity"].orientations(turns), np.stack([w, -z, x, -y], axis=1))
    np.testing.assert_allclose(CONVENTIONS["openxr"].positions(points), np.stack([-pz, -px, py], axis=1))
    np.testing.assert_allclose(CONVENTIONS["openxr"].orientations(turns), np.stack([w, -z, -x, y], axis=1))
    np.testing.assert_allclose(CONVENTIONS["vicon_mm"].positions(points), points / 1000.0)
    np.testing.assert_allclose(CONVENTIONS["xsens_y_up"].orientations(turns), np.stack([w, z, x, y], axis=1))
