"""The pose filter: no sign, no turned world and no half turn makes a difference."""

from math import nan, pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from retarget import rotations
from retarget.live.one_euro import OneEuroSettings
from retarget.live.pose_filter import PoseFilter
from retarget.rotations import FloatArray

SETTINGS = OneEuroSettings(min_cutoff=1.0, beta=1.0)
DT = 0.01


def run(position: FloatArray, orientation: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Filtered tracks (n, k, 3) and (n, k, 4)."""
    poses = PoseFilter(position.shape[1], position=SETTINGS, orientation=SETTINGS)
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
    plain = run(position, orientation)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], orientation.shape[:2])[..., None]
    signed = run(position, signs * orientation)
    assert (signed[0] == plain[0]).all()
    assert rotations.angle_between(signed[1], plain[1]).max() < 1e-7
    assert (np.einsum("nkj,nkj->nk", signed[1][1:], signed[1][:-1]) > 0.0).all()
    world = rotations.normalise(np.random.default_rng(seed + 1).normal(size=4))
    turned = run(rotations.rotate(world, position), rotations.multiply(world, orientation))
    assert np.abs(turned[0] - rotations.rotate(world, plain[0])).max() < 1e-9
    assert rotations.angle_between(turned[1], rotations.multiply(world, plain[1])).max() < 1e-6


def test_one_axis_is_the_plain_filter_of_the_angle_through_many_half_turns() -> None:
    """Ten turns about one axis: as if the angle were a number that knows no 180 degrees."""
    angle = np.linspace(0.0, 20.0 * pi, 600)
    expected, _ = run(angle[:, None, None] * np.array([1.0, 0.0, 0.0]), np.tile([1.0, 0.0, 0.0, 0.0], (600, 1, 1)))
    expected = expected[:, 0, 0]
    axis = np.array([0.6, 0.0, 0.8])
    _, found = run(np.zeros((600, 1, 3)), rotations.from_axis_angle(axis, angle[:, None]))
    wanted = rotations.from_axis_angle(axis, expected[:, None])
    assert np.abs(angle - expected).max() > 0.05
    assert np.abs(np.linalg.norm(found, axis=2) - 1.0).max() < 1e-9
    assert rotations.angle_between(found, wanted).max() < 1e-6


def test_noise_about_180_degrees_is_smoothed_as_anywhere_else() -> None:
    rng = np.random.default_rng(5)
    noise = rotations.from_rotation_vector(0.02 * rng.normal(size=(400, 1, 3)))
    position = np.zeros((400, 1, 3))
    half = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), pi)
    _, found = run(position, rotations.multiply(noise, half))
    _, anywhere = run(position, noise)
    spread = rotations.angle_between(found, half)[50:]
    assert spread.max() < 0.025
    assert spread == pytest.approx(rotations.angle_between(anywhere, rotations.IDENTITY)[50:], abs=1e-7)


def test_a_step_arrives_the_short_way_and_never_goes_beyond() -> None:
    start, end = rotations.normalise([1.0, 0.2, 0.0, 0.1]), rotations.normalise([-0.1, 0.7, -0.5, 0.0])
    orientation = np.concatenate([np.tile(start, (1, 1, 1)), np.tile(-end, (800, 1, 1))])
    _, found = run(np.zeros((801, 1, 3)), orientation)
    to_go = rotations.angle_between(found, end)[:, 0]
    gone = rotations.angle_between(found, start)[:, 0]
    assert (np.diff(to_go) <= 1e-9).all() and to_go[-1] < 1e-3
    assert gone + to_go == pytest.approx(to_go[0], abs=1e-6)


def test_what_is_off_is_left_and_what_is_missing_waits() -> None:
    position, orientation = walk(7, count=2, steps=3)
    off = PoseFilter(2, position=None, orientation=None)
    found = off.step(np.zeros(2), position[0], orientation[0])
    assert (found[0] == position[0]).all() and (found[1] == orientation[0]).all()
    poses = PoseFilter(2, position=SETTINGS, orientation=SETTINGS)
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
