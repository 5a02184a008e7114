"""Tracks between frames."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from retarget import rotations
from retarget.interpolate import along_arcs, along_lines, locate, valid_at

CLOCK = np.array([0.0, 0.1, 0.3, 0.35])


def test_times_lie_between_their_neighbours_on_an_uneven_clock() -> None:
    at = locate(CLOCK, np.array([-1.0, 0.0, 0.05, 0.1, 0.2, 0.35, 9.0]))
    np.testing.assert_array_equal(at.before, [0, 0, 0, 1, 1, 3, 3])
    np.testing.assert_allclose(at.share, [0.0, 0.0, 0.5, 0.0, 0.5, 0.0, 0.0])
    np.testing.assert_array_equal(at.exact, [True, True, False, True, False, True, True])


@given(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=20))
def test_any_time_has_a_share_below_one(times: list[float]) -> None:
    at = locate(CLOCK, np.array(times))
    assert np.all((at.share >= 0.0) & (at.share < 1.0)) and np.all(at.after < len(CLOCK))
    held = np.clip(times, CLOCK[0], CLOCK[-1])
    np.testing.assert_allclose(CLOCK[at.before] + at.share * (CLOCK[at.after] - CLOCK[at.before]), held, atol=1e-9)


def test_a_lost_neighbour_counts_only_where_it_is_used() -> None:
    track = np.arange(12.0).reshape(4, 1, 3)
    track[1] = np.nan
    valid = np.array([[True], [False], [True], [True]])
    at = locate(CLOCK, np.array([0.0, 0.05, 0.2, 0.3, 0.325]))
    np.testing.assert_array_equal(valid_at(valid, at)[:, 0], [True, False, False, True, True])
    np.testing.assert_array_equal(np.isfinite(along_lines(track, at)).all(axis=(1, 2)), valid_at(valid, at)[:, 0])


def test_orientations_take_the_short_arc() -> None:
    turn = rotations.from_axis_angle([0.0, 0.0, 1.0], np.array([0.0, 0.2, 0.6, 0.8]))[:, None]
    turn[2] *= -1.0
    half = along_arcs(turn, locate(CLOCK, np.array([0.2])))
    np.testing.assert_allclose(np.abs(rotations.log(half[0, 0])), [0.0, 0.0, 0.4], atol=1e-12)
