"""The zero-moment point of a motion, against mechanics."""

import numpy as np
import pytest

from retarget.viewer.snapshot import GRAVITY, SPACING_S, rows_around, zero_moment_point


def test_at_rest_it_is_below_the_centre_of_mass() -> None:
    com = np.tile([0.02, -0.01, 0.25], (3, 1))
    np.testing.assert_allclose(zero_moment_point(np.array([0.0, 0.04, 0.08]), com), [0.02, -0.01])


@pytest.mark.parametrize("times", [[0.0, 0.04, 0.08], [1.0, 1.02, 1.1]])
def test_under_a_constant_acceleration_it_is_behind(times: list[float]) -> None:
    """Parabolas are met exactly, also where looks come at uneven times."""
    at, pull = np.array(times), np.array([0.8, -0.3, 0.5])
    com = np.array([0.0, 0.0, 0.25]) + 0.5 * pull * (at[:, None] - 0.9) ** 2
    expected = com[1, :2] - com[1, 2] / (GRAVITY + 0.5) * pull[:2]
    np.testing.assert_allclose(zero_moment_point(at, com), expected, atol=1e-9)


@pytest.mark.parametrize("times", [[0.0, 0.0, 0.1], [0.0, 0.5, 0.54], [0.0, 0.04, 0.04]])
def test_looks_too_near_or_too_far_apart_give_nothing(times: list[float]) -> None:
    assert np.isnan(zero_moment_point(np.array(times), np.ones((3, 3)))).all()


def test_in_free_fall_there_is_none() -> None:
    at = np.array([0.0, 0.04, 0.08])
    com = np.column_stack([np.zeros(3), np.zeros(3), 1.0 - 0.5 * 9.9 * at**2])
    assert np.isnan(zero_moment_point(at, com)).all()


def test_rows_of_a_recording_are_as_far_apart() -> None:
    times = np.linspace(0.0, 0.792, 100)
    before, row, after = rows_around(times, 50)
    assert (times[row] - times[before], times[after] - times[row]) == pytest.approx((SPACING_S, SPACING_S))
    assert rows_around(times, 0)[:2] == (0, 0) and rows_around(times, 99)[1:] == (99, 99)
    assert rows_around(np.linspace(0.0, 0.4, 5), 2) == (1, 2, 3), "coarser than that, the next ones are taken"
