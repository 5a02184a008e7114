"""The zero-moment point of a motion, against mechanics."""

import numpy as np
import pytest

from retarget.viewer.snapshot import GRAVITY, zero_moment_point


def test_at_rest_it_is_below_the_centre_of_mass() -> None:
    com = np.tile([0.02, -0.01, 0.25], (3, 1))
    np.testing.assert_allclose(zero_moment_point(np.array([-0.04, 0.0, 0.04]), com), [0.02, -0.01])


@pytest.mark.parametrize("times", [[-0.04, 0.0, 0.04], [-0.02, -0.01, 0.0, 0.03]])
def test_under_a_constant_acceleration_it_is_behind(times: list[float]) -> None:
    """Parabolas are met exactly, also where looks come at uneven times."""
    at, pull = np.array(times), np.array([0.8, -0.3, 0.5])
    com, now = (np.array([0.0, 0.0, 0.25]) + 0.5 * pull * (times[..., None] + 0.9) ** 2 for times in (at, np.zeros(1)))
    expected = now[0, :2] - now[0, 2] / (GRAVITY + 0.5) * pull[:2]
    np.testing.assert_allclose(zero_moment_point(at, com), expected, atol=1e-9)


@pytest.mark.parametrize("times", [[0.0], [0.0, 0.04, 0.05], [-0.05, -0.04, 0.0]])
def test_without_looks_before_and_after_there_is_none(times: list[float]) -> None:
    assert np.isnan(zero_moment_point(np.array(times), np.ones((len(times), 3)))).all()


def test_in_free_fall_there_is_none() -> None:
    at = np.array([-0.04, 0.0, 0.04])
    com = np.column_stack([np.zeros(3), np.zeros(3), 1.0 - 0.5 * 9.9 * at**2])
    assert np.isnan(zero_moment_point(at, com)).all()
