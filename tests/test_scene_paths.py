"""Motions of a file: paths are continuous, velocities are their derivatives, loops begin anew."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from retarget import rotations
from retarget.scene_parts import Obstacle
from retarget.scene_paths import Drift, Motion, Path, Rest, motion_of
from retarget.scene_poses import STILL, MovingPose

STEP = 1e-5
COORDINATES = st.tuples(*[st.floats(-2, 2)] * 3)
TURNS = st.tuples(*[st.floats(-1.5, 1.5)] * 3).map(lambda turn: tuple(rotations.from_rotation_vector(turn).tolist()))


def motion(**keys: Any) -> Motion:
    return motion_of(Obstacle.model_validate({"shape": {"sphere": {"radius": 0.1}}} | keys))


@st.composite
def paths(draw: st.DrawFn, *, loop: bool = False) -> Path:
    count = draw(st.integers(2, 6))
    times = np.cumsum(draw(st.lists(st.floats(0.1, 2), min_size=count, max_size=count)))
    points = [{"time": float(time), "pos": draw(COORDINATES), "quat": draw(TURNS)} for time in times]
    if loop:
        points[-1] |= {"pos": points[0]["pos"], "quat": points[0]["quat"]}
    found = motion(path=points, loop=loop)
    assert isinstance(found, Path)
    return found


def apart(a: MovingPose, b: MovingPose) -> float:
    """Distance and angle between two poses, the larger one."""
    way = float(np.linalg.norm(np.subtract(a.pose.position, b.pose.position)))
    return max(way, float(rotations.angle_between(a.pose.quat, b.pose.quat)))


def check_derivative(path: Motion, time: float) -> None:
    before, now, after = path.at(time - STEP), path.at(time), path.at(time + STEP)
    rate = np.subtract(after.pose.position, before.pose.position) / (2 * STEP)
    assert_allclose(rate, now.linear, atol=1e-6)
    turn = rotations.log(rotations.multiply(after.pose.quat, rotations.conjugate(before.pose.quat)))
    assert_allclose(turn / (2 * STEP), now.angular, atol=1e-6)


@given(paths())
def test_a_path_is_continuous_and_goes_through_its_points(path: Path) -> None:
    for time, piece in zip(path.times, path.pieces, strict=True):
        assert apart(path.at(time), MovingPose(piece.pose)) < 1e-9
        assert apart(path.at(time - 1e-9), path.at(time)) < 1e-6


@given(paths(), st.floats(0.01, 0.99))
def test_velocity_is_the_derivative(path: Path, share: float) -> None:
    for index in range(len(path.times) - 1):
        check_derivative(path, path.times[index] + share * (path.times[index + 1] - path.times[index]))


@given(paths(), st.floats(0.001, 100))
def test_before_and_after_a_path_it_rests(path: Path, time: float) -> None:
    early, late = path.at(path.times[0] - time), path.at(path.times[-1] + time)
    assert (early.linear, early.angular, late.linear, late.angular) == (STILL,) * 4
    assert apart(early, MovingPose(path.pieces[0].pose)) < 1e-12
    assert apart(late, MovingPose(path.pieces[-1].pose)) < 1e-12


@given(paths(loop=True), st.floats(0, 1, exclude_max=True), st.integers(1, 1000))
def test_a_loop_begins_anew(path: Path, share: float, rounds: int) -> None:
    period = path.times[-1] - path.times[0]
    time = path.times[0] + share * period
    assert apart(path.at(time), path.at(time + rounds * period)) < 1e-6
    assert apart(path.at(path.times[-1] - 1e-9), path.at(path.times[-1])) < 1e-6


@given(paths(loop=True), st.floats(0, 500))
def test_a_loop_never_rests_at_its_seam(path: Path, time: float) -> None:
    assert path.at(path.times[-1] + time).linear in [piece.linear for piece in path.pieces[:-1]]


def test_half_a_turn_takes_its_time() -> None:
    turning = motion(path=[{"time": 1, "pos": [0, 0, 0]}, {"time": 3, "pos": [2, 0, 0], "quat": [0, 0, 0, 1]}])
    now = turning.at(2.0)
    assert now.pose.position == pytest.approx((1, 0, 0))
    assert now.linear == pytest.approx((1, 0, 0))
    assert np.abs(now.angular) == pytest.approx((0, 0, 0.5 * np.pi))
    assert float(rotations.angle_between(now.pose.quat, [1, 0, 0, 0])) == pytest.approx(0.5 * np.pi)


@given(COORDINATES, COORDINATES, st.floats(0.1, 0.9))
def test_a_constant_velocity_lasts_from_until(
    velocity: tuple[float, ...], spin: tuple[float, ...], share: float
) -> None:
    place = {"pos": [1, 2, 3], "quat": [0.6, 0, 0.8, 0]}
    drift = motion(velocity=velocity, angular_velocity=spin, at=place, **{"from": 1, "until": 3})
    assert isinstance(drift, Drift)
    check_derivative(drift, 1 + 2 * share)
    assert drift.at(0.0) == drift.at(-5.0) == MovingPose(drift.pose)
    assert drift.at(3.0) == drift.at(100.0) == MovingPose(drift.at(3.0).pose)
    assert_allclose(drift.at(3.0).pose.position, [1, 2, 3] + 2 * np.array(velocity), atol=1e-12)


def test_without_an_end_it_goes_on() -> None:
    assert motion(velocity=[0, 2, 0]).at(50.0).pose.position == pytest.approx((0, 100, 0))
    assert motion(angular_velocity=[0, 0, 1]).at(50.0).angular == (0, 0, 1)


def test_an_obstacle_that_stays() -> None:
    rest = motion(at={"pos": [1, 2, 3]})
    assert isinstance(rest, Rest)
    assert rest.at(0.0) == rest.at(9.0) == MovingPose(rest.pose)
