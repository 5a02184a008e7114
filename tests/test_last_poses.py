"""What is remembered of each sensor."""

import numpy as np

from retarget.live.last_poses import LastPoses

ROWS = np.array([2, 0])
POSE = np.array([[0.0, 0.1, 1.0, 1.0, 0.0, 0.0, 0.0], [1.0, 0.1, 1.0, 0.6, 0.8, 0.0, 0.0]])


def told() -> LastPoses:
    last = LastPoses(3)
    last.put(ROWS, 1.0, POSE)
    return last


def test_the_first_position_counts_as_a_change_and_the_first_orientation_does_not() -> None:
    last = told()
    assert (last.since[ROWS, :3] == 1.0).all() and np.isnan(last.since[ROWS, 3:]).all()
    assert np.isnan(last.since[1]).all() and last.at.tolist() == [1.0, -np.inf, 1.0]


def test_each_number_knows_its_last_change() -> None:
    for put in (True, False):
        last = told()
        moved = POSE.copy()
        moved[0, [1, 4]] += 0.001
        moved[1, 0] += 1e-7  # rounding
        if put:
            last.put(ROWS, 1.01, moved)
        else:
            last.go_on(ROWS, 1.01, moved, moved - POSE)
        assert last.since[2, 1] == 1.01 and last.since[2, 4] == 1.01
        assert last.since[0, 0] == 1.0 and last.since[2, 0] == 1.0 and np.isnan(last.since[2, 3])
        assert last.latest == 1.01 and last.before[2] == 1.0 and last.step[2, 1] > 0.0


def test_all_rows_are_a_slice_and_give_the_same() -> None:
    last, other = LastPoses(2), LastPoses(2)
    rows = np.arange(2)
    assert last.rows(rows) == slice(None) and last.rows(rows[::-1]) is not slice(None)
    assert isinstance(last.rows(rows[::-1]), np.ndarray) and isinstance(last.rows(rows[:1]), np.ndarray)
    for one, where in ((last, last.rows(rows)), (other, rows)):
        one.put(rows, 1.0, POSE)
        one.go_on(where, 1.1, POSE + 0.01, np.full((2, 7), 0.01))
    assert np.array_equal(last.since, other.since) and np.array_equal(last.pose, other.pose)


def test_a_long_way_is_no_step() -> None:
    last = told()
    last.put(ROWS, 3.0, POSE + 0.01)
    assert not last.step.any()
    assert (last.since[ROWS] == 3.0).all()


def test_nobody_is_told_of() -> None:
    last = told()
    last.put(ROWS[:0], 9.0, POSE[:0])
    assert last.latest == 1.0
