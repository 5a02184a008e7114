"""Smoothing by name: trembling is halved, motion is hardly late."""

from math import nan, pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from messages import refuses
from retarget import rotations
from retarget._solver import PoseFilter
from retarget.errors import UsageError
from retarget.live.playout import SMOOTHINGS, Cutoffs, pose_filter
from retarget.types import FloatArray

SETTINGS: Cutoffs = (1.0, 0.5, 1.0)


class Filtered:
    """Positions alone: k vectors of 3."""

    def __init__(self, count: int, settings: Cutoffs = SETTINGS) -> None:
        self._poses = PoseFilter(count, position=settings, orientation=None)
        self._turns = np.zeros((count, 4))
        self.reset = self._poses.reset

    def step(self, time: FloatArray, value: FloatArray) -> FloatArray:
        return self._poses.step(time, value, self._turns)[0]


def one_euro_run(values: FloatArray, dt: FloatArray, settings: Cutoffs = SETTINGS) -> FloatArray:
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
    assert one_euro_run(values[:, None, None] * [1.0, 0.0, 0.0], dt)[:, 0, 0] == pytest.approx(
        np.array(expected), abs=1e-12
    )


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_a_step_is_reached_without_going_beyond(seed: int) -> None:
    rng = np.random.default_rng(seed)
    before, after = rng.normal(size=(2, 4, 3))
    dt = rng.uniform(0.001, 0.15, 200)
    found = one_euro_run(np.concatenate([np.tile(before, (1, 1, 1)), np.tile(after, (200, 1, 1))]), dt)
    assert (found[0] == before).all()
    way = (found - before) / (after - before)
    assert (np.diff(way, axis=0) >= -1e-12).all() and way.max() <= 1.0 + 1e-9
    assert np.abs(found[-1] - after).max() < 1e-3
    still = one_euro_run(np.tile(before, (201, 1, 1)), dt)
    assert (still == before).all()


def test_it_smooths_at_rest_and_follows_in_motion() -> None:
    rng = np.random.default_rng(1)
    dt = np.full(499, 0.01)
    noise = 0.005 * rng.normal(size=(500, 1, 3))
    quick = (1.0, 20.0, 1.0)
    assert one_euro_run(noise, dt, quick)[100:].std() < 0.4 * noise.std()
    line = np.arange(500)[:, None, None] * 0.01 * np.array([1.0, -2.0, 0.5])
    lag = np.linalg.norm(line - one_euro_run(line, dt, quick), axis=2)[-1, 0] / np.linalg.norm([1.0, -2.0, 0.5])
    # First order: it trails by the time constant of its cutoff, which is 1 + 20 * 2.29 Hz.
    assert lag == pytest.approx(1.0 / (2.0 * pi * 46.8), rel=0.3)


def test_one_euro_turning_the_world_turns_the_result() -> None:
    rng = np.random.default_rng(2)
    values, dt = np.cumsum(rng.normal(size=(80, 5, 3)), axis=0), rng.uniform(0.001, 0.05, 79)
    world = rotations.normalise([0.1, 0.4, -0.8, 0.3])
    turned = rotations.rotate(world, one_euro_run(values, dt))
    assert np.abs(one_euro_run(rotations.rotate(world, values), dt) - turned).max() < 1e-9


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


POSE_FILTER_SETTINGS: Cutoffs = (1.0, 1.0, 1.0)
DT = 0.01


def pose_filter_run(position: FloatArray, orientation: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Filtered tracks (n, k, 3) and (n, k, 4)."""
    poses = PoseFilter(position.shape[1], position=POSE_FILTER_SETTINGS, orientation=POSE_FILTER_SETTINGS)
    found = [
        poses.step(np.full(position.shape[1], DT * i), *pose)
        for i, pose in enumerate(zip(position, orientation, strict=True))
    ]
    return np.array([p for p, _ in found]), np.array([q for _, q in found])


def walk(seed: int, count: int = 4, steps: int = 60) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    position = np.cumsum(0.02 * rng.normal(size=(steps, count, 3)), axis=0)
    orientation = np.empty((steps, count, 4))
    orientation[0] = rotations.normalise(rng.normal(size=(count, 4)))
    for i in range(1, steps):
        turn = rotations.from_rotation_vector(0.3 * rng.normal(size=(count, 3)))
        orientation[i] = rotations.multiply(turn, orientation[i - 1])
    return position, orientation


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1))
def test_signs_say_nothing_and_the_world_may_turn(seed: int) -> None:
    position, orientation = walk(seed)
    plain = pose_filter_run(position, orientation)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], orientation.shape[:2])[..., None]
    signed = pose_filter_run(position, signs * orientation)
    assert (signed[0] == plain[0]).all()
    assert rotations.angle_between(signed[1], plain[1]).max() < 1e-7
    assert (np.einsum("nkj,nkj->nk", signed[1][1:], signed[1][:-1]) > 0.0).all()
    world = rotations.normalise(np.random.default_rng(seed + 1).normal(size=4))
    turned = pose_filter_run(rotations.rotate(world, position), rotations.multiply(world, orientation))
    assert np.abs(turned[0] - rotations.rotate(world, plain[0])).max() < 1e-9
    assert rotations.angle_between(turned[1], rotations.multiply(world, plain[1])).max() < 1e-6


def test_one_axis_is_the_plain_filter_of_the_angle_through_many_half_turns() -> None:
    """Ten turns about one axis: as if the angle were a number that knows no 180 degrees."""
    angle = np.linspace(0.0, 20.0 * pi, 600)
    expected, _ = pose_filter_run(
        angle[:, None, None] * np.array([1.0, 0.0, 0.0]), np.tile([1.0, 0.0, 0.0, 0.0], (600, 1, 1))
    )
    expected = expected[:, 0, 0]
    axis = np.array([0.6, 0.0, 0.8])
    _, found = pose_filter_run(np.zeros((600, 1, 3)), rotations.from_axis_angle(axis, angle[:, None]))
    wanted = rotations.from_axis_angle(axis, expected[:, None])
    assert np.abs(angle - expected).max() > 0.05
    assert np.abs(np.linalg.norm(found, axis=2) - 1.0).max() < 1e-9
    assert rotations.angle_between(found, wanted).max() < 1e-6


def test_noise_about_180_degrees_is_smoothed_as_anywhere_else() -> None:
    rng = np.random.default_rng(5)
    noise = rotations.from_rotation_vector(0.02 * rng.normal(size=(400, 1, 3)))
    position = np.zeros((400, 1, 3))
    half = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), pi)
    _, found = pose_filter_run(position, rotations.multiply(noise, half))
    _, anywhere = pose_filter_run(position, noise)
    spread = rotations.angle_between(found, half)[50:]
    assert spread.max() < 0.025
    assert spread == pytest.approx(rotations.angle_between(anywhere, rotations.IDENTITY)[50:], abs=1e-7)


def test_a_step_arrives_the_short_way_and_never_goes_beyond() -> None:
    start, end = rotations.normalise([1.0, 0.2, 0.0, 0.1]), rotations.normalise([-0.1, 0.7, -0.5, 0.0])
    orientation = np.concatenate([np.tile(start, (1, 1, 1)), np.tile(-end, (800, 1, 1))])
    _, found = pose_filter_run(np.zeros((801, 1, 3)), orientation)
    to_go = rotations.angle_between(found, end)[:, 0]
    gone = rotations.angle_between(found, start)[:, 0]
    assert (np.diff(to_go) <= 1e-9).all() and to_go[-1] < 1e-3
    assert gone + to_go == pytest.approx(to_go[0], abs=1e-6)


def test_what_is_off_is_left_and_what_is_missing_waits() -> None:
    position, orientation = walk(7, count=2, steps=3)
    off = PoseFilter(2, position=None, orientation=None)
    found = off.step(np.zeros(2), position[0], orientation[0])
    assert (found[0] == position[0]).all() and (found[1] == orientation[0]).all()
    poses = PoseFilter(2, position=POSE_FILTER_SETTINGS, orientation=POSE_FILTER_SETTINGS)
    poses.step(np.zeros(2), position[0], orientation[0])
    lost = orientation[1].copy()
    lost[1] = nan
    found = poses.step(np.full(2, DT), position[1], lost)
    assert np.isnan(found[1]).tolist() == [[False] * 4, [True] * 4] and np.isfinite(found[0]).all()
    back = poses.step(np.full(2, 2 * DT), position[2], orientation[2])
    assert np.isfinite(back[1]).all()
    assert rotations.angle_between(back[1], orientation[2]).min() > 1e-3
    poses.reset(np.array([False, True]))
    fresh = poses.step(np.full(2, 3 * DT), position[0], orientation[0])
    assert fresh[0][1].tolist() == position[0, 1].tolist()
    assert rotations.angle_between(fresh[1][1], orientation[0, 1]) < 1e-9
    assert rotations.angle_between(fresh[1][0], orientation[0, 0]) > 1e-3


RATE = 100.0


def smoothed(name: str, track: FloatArray) -> FloatArray:
    """Positions (T,) along x through the filter."""
    made = pose_filter(name, 1)
    if made is None:
        return track
    found = [
        made.step(np.array([k / RATE]), np.array([[x, 0.0, 1.0]]), np.array([[1.0, 0.0, 0.0, 0.0]]))[0][0, 0]
        for k, x in enumerate(track)
    ]
    return np.array(found)


def test_trembling_at_rest_is_halved_and_a_moving_hand_is_hardly_late() -> None:
    noise = np.random.default_rng(2).normal(0.0, 0.001, 2000)
    rest = {name: float(np.std(np.diff(smoothed(name, noise)[500:]))) for name in SMOOTHINGS}
    assert rest["strong"] < rest["light"] < 0.5 * rest["off"]
    moving = np.arange(300) / RATE  # 1 m/s
    late = {name: float((moving - smoothed(name, moving))[-1]) for name in SMOOTHINGS}
    assert late["off"] == 0.0 < late["light"] < 0.015 < late["strong"] < 0.06


def test_an_unknown_name_is_refused() -> None:
    with refuses(UsageError, found="'ligth'"):
        pose_filter("ligth", 1)
