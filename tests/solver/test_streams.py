"""Stream filters: sensors out of frames, and poses that are sent in parts."""

import numpy as np

from messages import refuses
from retarget import rotations
from retarget._solver import PoseParts, SensorPlan

RNG = np.random.default_rng(7)
POSITION = RNG.normal(size=(4, 3))
ORIENTATION = rotations.normalise(RNG.normal(size=(4, 4)))
TRACKED = np.array([True, False, True, True])
TURN = rotations.normalise(RNG.normal(size=(3, 4)))
OFFSET = np.array([[0.0, 0.0, 0.0], [0.1, -0.2, 0.3], [0.0, 0.0, 0.0]])


def test_a_column_that_no_frame_has_is_refused() -> None:
    for points in (np.array([2, 4, -1]), np.array([2, 1])):
        with refuses(ValueError):
            SensorPlan(4, points=points, segments=np.array([-1, 1, 3]), turn=TURN, offset=OFFSET)
    plan = SensorPlan(4, points=np.array([2, 1, -1]), segments=np.array([-1, 1, 3]), turn=TURN, offset=OFFSET)
    with refuses(ValueError):
        plan.read(POSITION[:3], ORIENTATION[:3], TRACKED[:3])
    with refuses(ValueError):
        plan.read(POSITION, ORIENTATION, TRACKED[:3])


def test_a_missing_part_is_that_of_just_before() -> None:
    parts, rows = PoseParts(3), np.array([2, 0])
    place, turn = POSITION[:2].copy(), np.full((2, 4), np.nan)
    parts.complete(rows, 1.0, place, turn)
    assert (place == POSITION[:2]).all() and np.isnan(turn).all()
    for time, known in ((1.09, True), (1.11, False)):
        place, turn = np.full((2, 3), np.nan), ORIENTATION[:2].copy()
        parts.complete(rows, time, place, turn)
        assert (turn == ORIENTATION[:2]).all()
        assert (place == POSITION[:2]).all() if known else np.isnan(place).all()
    place, turn = POSITION[:1].copy(), np.full((1, 4), np.nan)
    parts.complete(np.array([0]), 1.2, place, turn)
    assert (turn == ORIENTATION[1]).all()


def test_bad_arrays_are_refused() -> None:
    parts = PoseParts(3)
    with refuses(ValueError):
        parts.complete(np.array([3]), 1.0, np.zeros((1, 3)), np.zeros((1, 4)))
    with refuses(ValueError, 1):
        parts.complete(np.array([0]), 1.0, np.zeros((2, 3)), np.zeros((1, 4)))
