"""The memory of each sensor: its last pose, and since when each number is the same."""

import numpy as np
import pytest

from messages import refuses
from retarget._solver import WatchedSensors
from retarget.live.sensor_validity import ValidityLimits, ValidityState, watched_sensors
from retarget.types import FloatArray

ROWS = np.array([2, 0])
POSE = np.array([[0.0, 0.1, 1.0, 1.0, 0.0, 0.0, 0.0], [1.0, 0.1, 1.0, 0.6, 0.8, 0.0, 0.0]])


def three_sensors() -> WatchedSensors:
    watched = watched_sensors(3, ValidityLimits())
    watched.put(ROWS, 1.0, POSE)
    return watched


def take(watched: WatchedSensors, time: float, pose: FloatArray, second_check: bool = False) -> bool:
    """Whether poses were taken at once."""
    position, orientation = pose[:, :3].copy(), pose[:, 3:].copy()
    found = watched.take(ROWS, time, position, orientation, np.ones(len(pose), dtype=bool), second_check)
    return found is None or found[1]


def test_the_first_position_counts_as_a_change_and_the_first_orientation_does_not() -> None:
    watched = three_sensors()
    assert (watched.since[ROWS, :3] == 1.0).all() and np.isnan(watched.since[ROWS, 3:]).all()
    assert np.isnan(watched.since[1]).all() and watched.at.tolist() == [1.0, -np.inf, 1.0]


def test_each_number_knows_its_last_change() -> None:
    for put in (True, False):
        watched = three_sensors()
        moved = POSE.copy()
        moved[0, [1, 4]] += 0.001
        moved[1, 0] += 1e-7  # rounding
        if put:
            watched.put(ROWS, 1.01, moved)
        else:
            assert take(watched, 1.01, moved)
        assert watched.since[2, 1] == 1.01 and watched.since[2, 4] == 1.01
        assert watched.since[0, 0] == 1.0 and watched.since[2, 0] == 1.0 and np.isnan(watched.since[2, 3])
        assert watched.latest == 1.01 and watched.before[2] == 1.0 and watched.step[2, 1] > 0.0
        assert (watched.pose[ROWS] == moved).all() and watched.still_for[0] == pytest.approx(0.01)


def test_far_or_late_or_refused_poses_need_a_second_check() -> None:
    near, far = POSE.copy(), POSE.copy()
    near[0, 0] += 0.059
    far[0, 0] += 0.061
    for time, pose, second_check, taken in (
        (1.01, near, False, True),
        (1.01, far, False, False),
        (1.0, near, False, False),
        (1.01, near, True, False),
    ):
        watched = three_sensors()
        assert take(watched, time, pose, second_check) is taken
        assert (watched.pose[2] == (near if taken else POSE)[0]).all()
    assert not take(watched_sensors(3, ValidityLimits()), 1.0, POSE)  # no last place is known


def test_without_an_orientation_its_changes_are_forgotten() -> None:
    watched, turned = three_sensors(), POSE.copy()
    turned[:, 4] += 0.001
    turned[:, 3:] /= np.linalg.norm(turned[:, 3:], axis=1, keepdims=True)
    assert take(watched, 1.01, turned) and not np.isnan(watched.since[ROWS, 4]).any()
    turned[:, 3:] = np.nan
    assert take(watched, 1.02, turned) and np.isnan(watched.since[:, 3:]).all()
    watched = three_sensors()
    watched.put(ROWS, 1.01, POSE + 0.001)
    watched.forget_turn(ROWS[:1])
    assert np.isnan(watched.since[2, 3:]).all() and not np.isnan(watched.since[0, 3:]).any()


def test_a_long_way_is_no_step() -> None:
    watched = three_sensors()
    watched.put(ROWS, 3.0, POSE + 0.01)
    assert not watched.step.any()
    assert (watched.since[ROWS] == 3.0).all()


def test_no_rows_change_nothing() -> None:
    watched = three_sensors()
    watched.put(ROWS[:0], 9.0, POSE[:0])
    assert watched.latest == 1.0


def test_sensors_never_received_are_not_in_use_and_those_outside_are_out_of_range() -> None:
    limits = ValidityLimits()
    watched, outside = watched_sensors(2, limits), np.array([[50.0, 0.0, 1.0]])
    turn, yes = POSE[:1, 3:].copy(), np.ones(1, dtype=bool)
    assert watched.judge(0.0).tolist() == [ValidityState.STALE] * 2
    late = limits.not_in_use_after
    assert watched.judge(late - 0.01).tolist() == [ValidityState.STALE] * 2
    watched.take(np.array([1]), late, outside, turn, yes, False)
    assert watched.judge(late).tolist() == [ValidityState.NOT_IN_USE, ValidityState.OUT_OF_RANGE]
    assert watched.judge(late + limits.stale_after + 0.01).tolist() == [ValidityState.NOT_IN_USE] * 2
    watched.put(np.array([1]), late, np.hstack([outside / 50.0, turn]))
    assert watched.judge(late + 0.01).tolist() == [ValidityState.NOT_IN_USE, ValidityState.FRESH]
    assert watched.judge(np.nan).tolist() == [ValidityState.NOT_IN_USE, ValidityState.STALE]


def test_bad_arrays_are_refused() -> None:
    watched, yes = three_sensors(), np.ones(2, dtype=bool)
    position, orientation = POSE[:, :3].copy(), POSE[:, 3:].copy()
    with refuses(ValueError):
        watched.take(np.array([3, 0]), 1.1, position, orientation, yes, False)
    with refuses(ValueError):
        watched.take(ROWS, 1.1, position, orientation, yes[:1], False)
    with refuses(ValueError):
        watched.put(ROWS, 1.1, position)
