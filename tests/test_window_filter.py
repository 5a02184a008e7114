"""Smooth, half a window late, and nothing where nothing is told."""

import numpy as np

from retarget.live.window_filter import WindowFilter
from retarget.rotations import FloatArray

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
RATE = 100.0


def run(made: WindowFilter, x: FloatArray, begin: float = 0.0) -> FloatArray:
    """Positions (T,) of a sensor that tells no turn, beside one that tells nothing else."""
    found = []
    for k, at in enumerate(x):
        position, orientation = np.array([[at, 0.0, 1.0], [np.nan] * 3]), np.array([[np.nan] * 4, UPRIGHT])
        placed, turned = made.step(np.full(2, begin + k / RATE), position, orientation)
        assert np.isnan(placed[1]).all() and np.isnan(turned[0]).all()
        np.testing.assert_allclose(turned[1], UPRIGHT, atol=1e-12)
        found.append(placed[0, 0])
    return np.array(found)


def test_an_even_motion_is_half_a_window_late_and_noise_is_less() -> None:
    time = np.arange(300) / RATE
    late = time - run(WindowFilter(2), time)
    np.testing.assert_allclose(late[20:], 0.06, atol=1e-6)
    assert late[0] == 0.0 and np.diff(late).max() < 0.01
    noise = np.random.default_rng(1).normal(0.0, 0.001, 500)
    assert np.std(run(WindowFilter(2), noise)[50:]) < 0.5 * np.std(noise)


def test_who_is_forgotten_begins_where_it_is() -> None:
    made = WindowFilter(2)
    run(made, np.zeros(50))
    made.reset(np.array([True, False]))
    assert run(made, np.ones(1), begin=0.5)[0] == 1.0


def test_a_turn_that_comes_later_is_taken_as_it_is() -> None:
    made, at = WindowFilter(1), np.array([[1.0, 2.0, 3.0]])
    made.step(np.array([0.0]), at, np.full((1, 4), np.nan))
    side = np.array([[0.0, 0.0, 0.0, 1.0]])
    placed, turned = made.step(np.array([0.01]), at, side)
    np.testing.assert_allclose(placed, at)
    np.testing.assert_allclose(np.abs(turned), side)
