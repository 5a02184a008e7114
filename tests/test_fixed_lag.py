"""The fixed-lag smoother: exact where motion is even, never beyond what was told, half a window late."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from retarget import rotations
from retarget.live.fixed_lag import FixedLag, Smoothed
from retarget.rotations import FloatArray

LENGTH = 0.120
COUNT = 5


def run(times: FloatArray, position: FloatArray, orientation: FloatArray) -> list[Smoothed]:
    """What is told after each of n poses (n, k, 3), (n, k, 4) at times (n)."""
    smoother = FixedLag(position.shape[1], length=LENGTH)
    return [
        smoother.step(np.full(position.shape[1], time), p, q)
        for time, p, q in zip(times, position, orientation, strict=True)
    ]


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1))
def test_even_motion_is_exact_at_the_time_that_is_told(seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = 10.0 + np.cumsum(rng.uniform(0.002, 0.02, 80))
    place, speed = rng.normal(size=(2, COUNT, 3))
    spin, start = rng.normal(size=(COUNT, 3)), rotations.normalise(rng.normal(size=(COUNT, 4)))
    signs = rng.choice([-1.0, 1.0], (80, COUNT, 1))

    def turned(time: FloatArray) -> FloatArray:
        return rotations.multiply(rotations.from_rotation_vector(time * spin), start)

    found = run(
        times,
        np.array([place + t * speed for t in times]),
        signs * np.array([turned(np.array([[t]])) for t in times]),
    )
    before = np.full(COUNT, -np.inf)
    for now, smooth in zip(times, found, strict=True):
        assert smooth.position == pytest.approx(place + smooth.time[:, None] * speed, abs=1e-9)
        # Uneven weights on an arc: an error of third order in the angle of the window.
        assert rotations.angle_between(smooth.orientation, turned(smooth.time[:, None])).max() < 1e-3
        assert (smooth.time > before).all() and (smooth.time <= now + 1e-12).all()
        before = smooth.time
    assert (np.abs(times[-1] - found[-1].time - 0.5 * LENGTH) < 0.015).all()


def test_nothing_goes_beyond_a_step_and_what_stands_stays() -> None:
    times = np.linspace(1.0, 1.99, 100)
    step = np.where(np.arange(100)[:, None, None] < 50, 0.0, 1.0) * np.ones((100, COUNT, 3))
    orientation = np.tile(rotations.normalise([0.5, -0.5, 0.1, 0.3]), (100, COUNT, 1))
    found = run(times, step, orientation)
    track = np.array([smooth.position for smooth in found])
    assert track.min() >= 0.0 and track.max() <= 1.0 + 1e-12
    assert (np.diff(track, axis=0) >= -1e-12).all()
    assert track[-1] == pytest.approx(np.ones((COUNT, 3))) and (track[49] == 0.0).all()
    assert track[56].mean() == pytest.approx(0.5, abs=0.15)
    assert max(float(rotations.angle_between(s.orientation, orientation[0]).max()) for s in found) < 1e-7


def test_it_smooths() -> None:
    rng = np.random.default_rng(1)
    noise = rng.normal(size=(300, COUNT, 3))
    orientation = rotations.from_rotation_vector(0.05 * rng.normal(size=(300, COUNT, 3)))
    found = run(np.linspace(1.0, 3.99, 300), noise, orientation)[20:]
    assert np.std([s.position for s in found]) < 0.45
    assert np.mean([rotations.angle_between(s.orientation, rotations.IDENTITY) for s in found]) < 0.45 * 0.08


def test_turning_the_world_turns_the_result() -> None:
    rng = np.random.default_rng(2)
    times = 1.0 + np.cumsum(rng.uniform(0.002, 0.02, 50))
    position = rng.normal(size=(50, COUNT, 3))
    orientation = rotations.from_rotation_vector(0.3 * rng.normal(size=(50, COUNT, 3)))
    world = rotations.normalise([0.1, 0.4, -0.8, 0.3])
    plain = run(times, position, orientation)
    turned = run(times, rotations.rotate(world, position), rotations.multiply(world, orientation))
    for a, b in zip(plain, turned, strict=True):
        assert np.abs(rotations.rotate(world, a.position) - b.position).max() < 1e-9
        assert rotations.angle_between(rotations.multiply(world, a.orientation), b.orientation).max() < 1e-6


def test_rows_that_tell_nothing_new_are_not_taken() -> None:
    smoother = FixedLag(3, length=LENGTH, depth=4)
    one = np.tile(rotations.IDENTITY, (3, 1))
    nothing = smoother.step(np.full(3, np.nan), np.zeros((3, 3)), one)
    assert np.isnan(nothing.time).all() and np.isnan(nothing.position).all() and np.isnan(nothing.orientation).all()
    smoother.step(np.full(3, 1.0), np.zeros((3, 3)), one)
    position = np.ones((3, 3))
    position[1] = np.nan
    found = smoother.step(np.array([1.0, 1.02, 1.02]), position, one)
    assert found.time == pytest.approx([1.0, 1.0, 1.01])
    assert found.position[:, 0] == pytest.approx([0.0, 0.0, 0.5])
    for i in range(50):
        found = smoother.step(np.full(3, 2.0 + 0.01 * i), np.full((3, 3), float(i)), one)
    assert found.position[0, 0] == pytest.approx(47.5, abs=0.2)
    smoother.reset(np.array([True, False, False]))
    found = smoother.step(np.full(3, 2.5), np.full((3, 3), 9.0), one)
    assert found.position[0].tolist() == [9.0] * 3 and found.time[0] == 2.5
