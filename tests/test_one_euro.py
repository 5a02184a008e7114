"""The One-Euro filter: what stands stays, what steps arrives, what moves is followed."""

from math import inf, nan, pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from retarget import rotations
from retarget.live.one_euro import OneEuroSettings
from retarget.live.pose_filter import PoseFilter
from retarget.rotations import FloatArray
from support.messages import refuses

SETTINGS = OneEuroSettings(min_cutoff=1.0, beta=0.5, d_cutoff=1.0)


class Filtered:
    """Positions alone: k vectors of 3."""

    def __init__(self, count: int, settings: OneEuroSettings = SETTINGS) -> None:
        self._poses = PoseFilter(count, position=settings, orientation=None)
        self._turns = np.zeros((count, 4))
        self.reset = self._poses.reset

    def step(self, time: FloatArray, value: FloatArray) -> FloatArray:
        return self._poses.step(time, value, self._turns)[0]


def run(values: FloatArray, dt: FloatArray, settings: OneEuroSettings = SETTINGS) -> FloatArray:
    """Filtered track (n, k, 3) of a track (n, k, 3), with n - 1 time steps."""
    euro, now = Filtered(values.shape[1], settings), 3.0
    found = []
    for value, step in zip(values, [0.0, *dt], strict=True):
        now += float(step)
        found.append(euro.step(np.full(values.shape[1], now), value))
    return np.array(found)


def test_it_is_the_filter_of_the_paper() -> None:
    """Algorithm 1 of the paper, on one component, with irregular times."""
    rng = np.random.default_rng(0)
    values, dt = rng.normal(size=200), rng.uniform(0.002, 0.03, 199)

    def alpha(cutoff: float, step: float) -> float:
        return 1.0 / (1.0 + 1.0 / (2.0 * pi * cutoff) / step)

    expected, speed = [values[0]], 0.0
    for value, step in zip(values[1:], dt, strict=True):
        speed += alpha(1.0, step) * ((value - expected[-1]) / step - speed)
        share = alpha(1.0 + 0.5 * abs(speed), step)
        expected.append(share * value + (1.0 - share) * expected[-1])
    assert run(values[:, None, None] * [1.0, 0.0, 0.0], dt)[:, 0, 0] == pytest.approx(np.array(expected), abs=1e-12)


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_a_step_is_reached_without_going_beyond(seed: int) -> None:
    rng = np.random.default_rng(seed)
    before, after = rng.normal(size=(2, 4, 3))
    dt = rng.uniform(0.001, 0.15, 200)
    found = run(np.concatenate([np.tile(before, (1, 1, 1)), np.tile(after, (200, 1, 1))]), dt)
    assert (found[0] == before).all()
    way = (found - before) / (after - before)
    assert (np.diff(way, axis=0) >= -1e-12).all() and way.max() <= 1.0 + 1e-9
    assert np.abs(found[-1] - after).max() < 1e-3
    still = run(np.tile(before, (201, 1, 1)), dt)
    assert (still == before).all()


def test_it_smooths_at_rest_and_follows_in_motion() -> None:
    rng = np.random.default_rng(1)
    dt = np.full(499, 0.01)
    noise = 0.005 * rng.normal(size=(500, 1, 3))
    quick = OneEuroSettings(min_cutoff=1.0, beta=20.0)
    assert run(noise, dt, quick)[100:].std() < 0.4 * noise.std()
    line = np.arange(500)[:, None, None] * 0.01 * np.array([1.0, -2.0, 0.5])
    lag = np.linalg.norm(line - run(line, dt, quick), axis=2)[-1, 0] / np.linalg.norm([1.0, -2.0, 0.5])
    # First order: it trails by the time constant of its cutoff, which is 1 + 20 * 2.29 Hz.
    assert lag == pytest.approx(1.0 / (2.0 * pi * 46.8), rel=0.3)


def test_turning_the_world_turns_the_result() -> None:
    rng = np.random.default_rng(2)
    values, dt = np.cumsum(rng.normal(size=(80, 5, 3)), axis=0), rng.uniform(0.001, 0.05, 79)
    world = rotations.normalise([0.1, 0.4, -0.8, 0.3])
    turned = rotations.rotate(world, run(values, dt))
    assert np.abs(run(rotations.rotate(world, values), dt) - turned).max() < 1e-9


def test_rows_have_their_own_times_and_are_forgotten_one_by_one() -> None:
    euro = Filtered(3)
    one, two = np.zeros((3, 3)), np.ones((3, 3))
    euro.step(np.array([1.0, 2.0, nan]), one)
    found = euro.step(np.array([1.0, 2.1, 5.0]), two)
    assert (found[0] == 0.0).all() and (found[1] > 0.0).all() and (found[1] < 1.0).all() and (found[2] == 1.0).all()
    missing = np.where([[False], [True], [False]], nan, two)
    assert np.isnan(euro.step(np.array([1.1, 2.2, 5.1]), missing)).tolist() == [[False] * 3, [True] * 3, [False] * 3]
    again = euro.step(np.array([1.2, 2.2, 5.2]), two)
    assert (found[1] < again[1]).all() and (again[1] < 1.0).all()
    euro.reset(np.array([True, False, False]))
    final = euro.step(np.array([0.5, 2.1, 5.3]), 7.0 * two)
    assert (final[0] == 7.0).all() and (final[1] == again[1]).all() and (final[2] < 7.0).all()


@pytest.mark.parametrize("wrong", [{"min_cutoff": 0.0}, {"beta": -1.0}, {"d_cutoff": nan}, {"min_cutoff": inf}])
def test_settings_that_are_none(wrong: dict[str, float]) -> None:
    with refuses(ValueError, next(iter(wrong))):
        OneEuroSettings(**wrong)
