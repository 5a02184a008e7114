"""What is followed lies on a grid: near to what was measured, the same when it is laid on it again, and short."""

import zlib

import numpy as np

from retarget.clip import Playback, lay_on_ticks
from retarget.frames import SensorSample
from retarget.performer import load_performer
from retarget.sensor_grid import STEP_M, STEP_TURN, on_grid
from sim.performer import synthetic_performer


def sample(count: int = 500) -> SensorSample:
    random = np.random.default_rng(7)
    turn = random.normal(size=(count, 4))
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    names = tuple(str(number) for number in range(count))
    return SensorSample(names, random.uniform(-3.0, 3.0, (count, 3)), turn, np.ones(count, dtype=bool))


def test_nothing_moves_by_more_than_half_a_step_and_only_once() -> None:
    before = sample()
    before.position[3], before.orientation[5] = np.nan, np.nan
    after = on_grid(before)
    assert np.nanmax(np.abs(after.position - before.position)) <= STEP_M / 2
    assert np.nanmax(np.abs(after.orientation - before.orientation)) <= STEP_TURN / 2
    assert np.nanmax(np.abs(np.linalg.norm(after.orientation, axis=1) - 1.0)) < 5e-7
    assert np.isnan(after.position[3]).all() and np.isnan(after.orientation[5]).all()
    again = on_grid(after)
    np.testing.assert_array_equal(again.position, after.position)
    np.testing.assert_array_equal(again.orientation, after.orientation)


def test_it_is_half_as_long() -> None:
    before = sample()
    after = on_grid(before)
    for name in ("position", "orientation"):
        size = len(zlib.compress(getattr(before, name).tobytes()))
        assert len(zlib.compress(getattr(after, name).tobytes())) < 0.6 * size


def test_a_clip_is_on_it() -> None:
    clip = lay_on_ticks(
        synthetic_performer(), performer=load_performer("five"), playback=Playback(end=0.5), rate_hz=125.0
    )
    now = clip.sample(7)
    np.testing.assert_array_equal(on_grid(now).position, now.position)
    np.testing.assert_array_equal(on_grid(now).orientation, now.orientation)
