"""Poses that no room and no rotation holds are found, and only those."""

import numpy as np
import pytest

from retarget.sources.pose_bounds import MAX_COORDINATE, unusable

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
