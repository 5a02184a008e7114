"""`_solver.TrajectoryGenerator`: limits in every tick, straight lines, exact arrival, nothing overshoots."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from messages import refuses
from retarget._solver import TrajectoryGenerator
from retarget.types import FloatArray

ROUNDING = 1e-9
"""rad, and with dt^-3 the jerk that rounding of a position makes."""
seeds = st.integers(0, 2**32 - 1)


class Move:
    """Random limits of some joints, and where they went, tick by tick; begins at a random posture, at rest."""

    def __init__(self, seed: int, *, joints: int | None = None) -> None:
        self.random = np.random.default_rng(seed)
        n = joints or int(self.random.integers(1, 8))
        self.dt = float(self.random.choice([0.01, 0.02]))
        self.velocity = 10.0 ** self.random.uniform(-0.3, 1.0, n)
        self.acceleration = 10.0 ** self.random.uniform(0.7, 2.0, n)
        self.jerk = 10.0 ** self.random.uniform(1.5, 3.5, n)
        self.generator = TrajectoryGenerator(self.velocity, self.acceleration, self.jerk, dt=self.dt)
        self.start = self.posture()
        self.generator.reset(self.start)
        self.rows = [self.start] * 4

    def posture(self) -> FloatArray:
        """Some joints often do not differ from zero."""
        n = len(self.velocity)
        anywhere = self.random.uniform(-1.5, 1.5, n)
        return np.where(self.random.random(n) < self.random.choice([0.5, 1.0]), anywhere, 0.0)

    def step(self, target: FloatArray, speed_override: float = 1.0) -> FloatArray:
        self.rows.append(self.generator.step(target, speed_override))
        np.testing.assert_array_equal(self.generator.position, self.rows[-1])
        return self.rows[-1]

    def arrive(self, target: FloatArray) -> FloatArray:
        """Postures (T, n) until at rest."""
        first = len(self.rows)
        settled = (self.velocity / self.acceleration).max() + (2.0 * self.acceleration / self.jerk).max()
        most = (np.abs(target - self.rows[-1]) / self.velocity).max() + 4.0 * settled
        while not self.generator.at_rest or len(self.rows) == first:
            self.step(target)
            assert (len(self.rows) - first) * self.dt <= most + 4.0 * self.dt
        np.testing.assert_array_equal(self.generator.position, target)
        np.testing.assert_array_equal(self.generator.velocity, 0.0)
        return np.array(self.rows[first:])

    def assert_within_limits(self) -> None:
        once, twice, thrice = (np.abs(np.diff(self.rows, n=n, axis=0)) for n in (1, 2, 3))
        assert (once <= self.velocity * self.dt + ROUNDING).all()
        assert (twice <= self.acceleration * self.dt**2 + ROUNDING).all()
        assert (thrice <= self.jerk * self.dt**3 + ROUNDING).all()


@settings(max_examples=30)
@given(seeds)
def test_a_move_from_rest_to_rest_is_a_straight_line(seed: int) -> None:
    move = Move(seed)
    target = move.posture()
    rows = move.arrive(target)
    move.assert_within_limits()
    way = target - move.start
    share = (rows - move.start) @ way / max(float(way @ way), 1e-300)
    assert np.abs(rows - move.start - share[:, None] * way).max() < ROUNDING
    assert (np.diff(share, prepend=0.0) > -ROUNDING).all() and share.max() <= 1.0 + ROUNDING


@settings(max_examples=30)
@given(seeds)
def test_it_is_about_as_fast_as_its_limits(seed: int) -> None:
    move = Move(seed)
    target = move.posture()
    way, dt = np.abs(target - move.start), move.dt
    least = (way / move.velocity).max()
    most = least + (move.velocity / move.acceleration).max() + (2.0 * move.acceleration / move.jerk).max()
    assert not way.any() or least <= dt * len(move.arrive(target)) <= most + 3.001 * dt


@pytest.mark.long
@settings(max_examples=30)
@given(seeds)
def test_targets_and_overrides_that_change_in_every_tick_keep_the_limits(seed: int) -> None:
    move = Move(seed)
    low = high = move.start
    jumpy, overrides = move.random.random() < 0.5, move.random.random() < 0.5
    target = move.posture()
    for _ in range(300):
        if jumpy and move.random.random() < 0.2:
            target = move.posture()
        elif not jumpy:
            target = target + move.random.normal(0.0, 0.03, len(target))
        low, high = np.minimum(low, target), np.maximum(high, target)
        row = move.step(target, float(move.random.choice([0.0, 0.3, 1.0])) if overrides else 1.0)
        assert (low - ROUNDING <= row).all() and (row <= high + ROUNDING).all()  # nothing overshoots
    move.arrive(target)
    move.assert_within_limits()


@settings(max_examples=30)
@given(seeds)
def test_no_override_stops_and_a_move_goes_on_in_its_line(seed: int) -> None:
    move = Move(seed)
    target = move.start + 1.0
    for _ in range(3):
        move.step(target)
    while move.generator.velocity.any():
        move.step(target, 0.0)
    assert not move.generator.at_rest  # it stands, but not at its target
    move.arrive(target)
    move.assert_within_limits()
    rows = np.array(move.rows) - move.start
    assert np.abs(rows - rows[:, :1]).max() < ROUNDING


@settings(max_examples=30)
@given(seeds, st.floats(0.0, 5.0))
def test_a_start_beyond_the_limits_comes_back_within_them(seed: int, beyond: float) -> None:
    move = Move(seed)
    n = len(move.velocity)
    velocity = beyond * move.velocity * move.random.uniform(-1.0, 1.0, n)
    acceleration = move.acceleration * move.random.uniform(-1.0, 1.0, n)
    move.generator.reset(move.start, velocity, acceleration)
    moved = velocity * move.dt
    before = move.start - moved
    move.rows = [before - (moved - acceleration * move.dt**2), before, move.start]
    target = move.start + move.random.uniform(-100.0, 100.0, n)
    braking = ((np.abs(velocity) + 2.0 * move.velocity) / move.acceleration + 4.0 * move.acceleration / move.jerk).max()
    for _ in range(int(braking / move.dt) + 2):
        move.step(target)
    twice, thrice = (np.abs(np.diff(move.rows, n=k, axis=0)) for k in (2, 3))
    assert (twice <= move.acceleration * move.dt**2 + ROUNDING).all()
    assert (thrice <= move.jerk * move.dt**3 + ROUNDING).all()
    move.rows = move.rows[-4:]
    for _ in range(100):
        move.step(target)
    move.arrive(move.rows[-1])
    move.assert_within_limits()


@settings(max_examples=30)
@given(seeds)
def test_the_same_inputs_give_the_same_bits_whatever_was_before(seed: int) -> None:
    move, other = Move(seed, joints=6), Move(seed, joints=6)
    for _ in range(10):
        other.step(other.posture(), 0.7)
    velocity, acceleration = move.random.normal(size=6), move.random.normal(size=6)
    targets = [move.posture() for _ in range(50)]
    for each in (move, other):
        each.generator.reset(move.start, velocity, acceleration)
        each.rows = [each.step(target) for target in targets]
    np.testing.assert_array_equal(move.rows, other.rows)


numbers = st.floats(allow_nan=False, allow_infinity=False)


@settings(max_examples=50)
@given(st.lists(numbers, min_size=6, max_size=6), st.lists(st.floats(-1e6, 1e6), min_size=6, max_size=6))
def test_whatever_is_finite_stays_finite(targets: list[float], state: list[float]) -> None:
    generator = TrajectoryGenerator(np.array([1.0, 2.0]), np.array([10.0, 50.0]), np.array([100.0, 900.0]), dt=0.01)
    position, velocity, acceleration = np.array(state).reshape(3, 2)
    generator.reset(position, velocity, acceleration)
    for target in np.array(targets).reshape(3, 2):
        for override in (1.0, 0.0, 0.5):
            assert np.isfinite(generator.step(target, override)).all()
            assert np.isfinite(generator.velocity).all() and np.isfinite(generator.acceleration).all()


def test_what_is_no_number_no_shape_or_no_limit_is_refused() -> None:
    one, two = np.ones(1), np.ones(2)
    for bad in (0.0, -1.0, np.nan, np.inf):
        for values in ((bad, 1.0, 1.0, 0.01), (1.0, bad, 1.0, 0.01), (1.0, 1.0, bad, 0.01), (1.0, 1.0, 1.0, bad)):
            *limits, dt = values
            with pytest.raises(ValueError):
                TrajectoryGenerator(*(np.array([limit]) for limit in limits), dt=dt)
    with refuses(ValueError, "max_acceleration"):
        TrajectoryGenerator(one, two, one, dt=0.01)
    with refuses(ValueError, "100000 ticks"):
        TrajectoryGenerator(one, 0.001 * one, one, dt=0.01)
    generator = TrajectoryGenerator(two, two, two, dt=0.01)
    with refuses(ValueError, "call reset first"):
        generator.step(two)
    generator.reset(two)
    for state in ((np.full(2, np.nan),), (two, np.full(2, np.inf)), (two, two, one), (1e7 * two,)):
        with pytest.raises(ValueError):
            generator.reset(*state)
    for target in (one, np.array([0.0, np.nan])):
        with pytest.raises(ValueError):
            generator.step(target)
    for override in (-0.1, np.nan):
        with pytest.raises(ValueError):
            generator.step(two, override)
    with refuses(ValueError, "expected 0 to 1"):
        generator.step(two, 1.1)
    np.testing.assert_array_equal(generator.position, two)
