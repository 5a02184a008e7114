"""Trajectories: the approach is smooth, slow and exact at its end; speed override; retiming; steps within limits."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from followers import DT as APPROACH_DT
from followers import follower, op3, performer, postures
from hardware.errors import RetargetError
from messages import refuses
from retarget.model.body import JointLimits
from retarget.model.robot import load_robot
from retarget.report.motion_metrics import limit_violations
from retarget.run.trajectory import (
    REJOINING_S,
    SpeedOverrideTrajectory,
    approach,
    approach_trajectory,
    require_finite,
    retimed,
    step_share,
)
from retarget.types import FloatArray

DT = 0.008


def test_it_keeps_the_share_of_speed_and_acceleration() -> None:
    joint_map = load_robot("op3").joint_map
    start = np.zeros(20)
    goal = np.random.default_rng(1).uniform(-0.8, 0.3, 20)
    path = np.array([start, *approach(start, goal, joint_map, speed=0.2, dt=DT)])
    np.testing.assert_array_equal(path[-1], goal)
    limits = JointLimits(
        joint_map.lower, joint_map.upper, 0.2 * joint_map.max_velocity, 0.2 * joint_map.max_acceleration
    )
    counted = limit_violations(path, limits, DT)
    assert (counted.velocity, counted.acceleration) == (0, 0)
    assert np.abs(np.diff(path, axis=0)).max() > 0.9 * 0.2 * 4.5 * DT
    np.testing.assert_array_equal(path[-1], path[-2])


def test_there_is_no_way_when_already_there() -> None:
    joint_map = load_robot("op3").joint_map
    assert list(approach(np.zeros(20), np.zeros(20), joint_map, speed=0.2, dt=DT)) == []


def test_it_goes_faster_to_be_there_in_time_and_never_beyond_what_servos_can() -> None:
    joint_map = load_robot("op3").joint_map
    goal = np.random.default_rng(2).uniform(-0.8, 0.8, 20)
    limits = JointLimits(joint_map.lower, joint_map.upper, joint_map.max_velocity, joint_map.max_acceleration)
    for within in (1.0, 0.05):
        path = np.array([np.zeros(20), *approach(np.zeros(20), goal, joint_map, speed=0.05, dt=DT, within=within)])
        np.testing.assert_array_equal(path[-1], goal)
        counted = limit_violations(path, limits, DT)
        assert (counted.velocity, counted.acceleration) == (0, 0)
        assert (len(path) - 1) * DT <= within or within == 0.05
    assert (len(path) - 1) * DT > 0.05


MOST, CHANGE = np.array([0.01, 0.01]), np.array([0.002, 0.002])


def hump(height: float, ticks: int) -> FloatArray:
    """There, faster than it may be in the middle, at rest at both ends."""
    s = np.linspace(0.0, 1.0, ticks)
    return np.outer(s**3 * (10.0 - 15.0 * s + 6.0 * s**2), [height, -0.5 * height])


def test_what_keeps_the_speeds_is_left_to_the_bit() -> None:
    rows = hump(0.2, 100)
    assert retimed(rows, most=MOST, change=CHANGE) is rows
    assert retimed(rows[:1], most=MOST, change=CHANGE) is not None


@given(height=st.floats(0.5, 3.0), ticks=st.integers(40, 300))
@settings(max_examples=40, deadline=None)
def test_it_keeps_the_speeds_and_goes_from_the_first_row_to_the_last(height: float, ticks: int) -> None:
    rows = hump(height, ticks)
    laid = retimed(rows, most=MOST, change=CHANGE)
    assert (np.abs(np.diff(laid, axis=0)) <= MOST * (1.0 + 1e-6)).all()
    sharpest = np.maximum(CHANGE, np.abs(np.diff(rows, n=2, axis=0)).max(axis=0))
    assert (np.abs(np.diff(laid, n=2, axis=0)) <= sharpest * (1.0 + 1e-6)).all()
    np.testing.assert_allclose(laid[0], rows[0], atol=1e-12)
    np.testing.assert_allclose(laid[-1], rows[-1], atol=1e-12)
    np.testing.assert_allclose(laid[:, 1], -0.5 * laid[:, 0], atol=1e-9)


def test_it_is_slower_only_where_it_must() -> None:
    rows = np.concatenate([hump(0.1, 300), 0.1 * np.array([1.0, -0.5]) + hump(3.0, 100)])
    laid = retimed(rows, most=MOST, change=CHANGE)
    uniform = len(rows) * float((np.abs(np.diff(rows, axis=0)) / MOST).max())
    assert len(laid) < 0.5 * uniform
    assert laid[200] == pytest.approx(rows[200], abs=1e-12)


OVERRIDE_DT = 0.008
REJOINING = round(REJOINING_S / OVERRIDE_DT)
ROWS = np.cumsum(np.sin(np.linspace(0.0, np.pi, 40)))[:, None] * [1.0, -0.5]


def test_at_full_speed_it_is_row_by_row_to_the_bit() -> None:
    trajectory = SpeedOverrideTrajectory(ROWS, dt=OVERRIDE_DT)
    got = [trajectory.next() for _ in range(39)]
    assert np.array_equal(got, ROWS[1:]) and trajectory.done
    assert np.array_equal(trajectory.next(), ROWS[-1])


def test_who_is_there_already_is_done() -> None:
    trajectory = SpeedOverrideTrajectory(ROWS[:1], dt=OVERRIDE_DT)
    assert trajectory.done and np.array_equal(trajectory.next(0.5), ROWS[0])


def test_at_half_override_it_takes_twice_as_long_at_half_the_speed() -> None:
    trajectory = SpeedOverrideTrajectory(ROWS, dt=OVERRIDE_DT)
    got = [ROWS[0]]
    while not trajectory.done:
        got.append(trajectory.next(0.5))
    assert len(got) == 79
    steps, whole = np.diff(got, axis=0), np.diff(ROWS, axis=0)
    np.testing.assert_allclose(np.abs(steps).max(axis=0), 0.5 * np.abs(whole).max(axis=0))
    assert (
        np.abs(np.diff(steps, axis=0)).max(axis=0) <= 0.5 * np.abs(np.diff(whole, axis=0)).max(axis=0) + 1e-12
    ).all()


@given(st.lists(st.floats(0.25, 1.0), min_size=200, max_size=200))
@settings(max_examples=40, deadline=None)
def test_no_step_is_longer_than_its_override_and_the_end_is_exact(overrides: list[float]) -> None:
    trajectory, before, most = (
        SpeedOverrideTrajectory(ROWS, dt=OVERRIDE_DT),
        ROWS[0],
        np.abs(np.diff(ROWS, axis=0)).max(axis=0),
    )
    for override in overrides:
        here = trajectory.next(override)
        assert (np.abs(here - before) <= override * most + 1e-12).all()
        before = here
    assert trajectory.done and np.array_equal(before, ROWS[-1])


def test_left_and_taken_up_again_it_comes_back_from_where_the_robot_stands_without_a_leap() -> None:
    trajectory, offset = SpeedOverrideTrajectory(ROWS, dt=OVERRIDE_DT), np.array([0.3, -0.2])
    for _ in range(10):
        last = trajectory.next()
    trajectory.leave()
    before, here = (trajectory.left, trajectory.done), last + offset
    got = [here]
    while not trajectory.done:
        got.append(trajectory.next(here=here))
    most = np.abs(np.diff(ROWS, axis=0)).max(axis=0) + 1.5 * np.abs(offset) / REJOINING
    steps = np.diff(got, axis=0)
    assert (np.abs(steps) <= most * 1.001).all() and (np.abs(steps[0]) < 0.02 * most).all()
    assert before == (True, False) and np.array_equal(got[-1], ROWS[-1])


def test_left_at_its_end_it_is_rejoined() -> None:
    trajectory = SpeedOverrideTrajectory(ROWS, dt=OVERRIDE_DT)
    for _ in range(39):
        trajectory.next()
    assert trajectory.done
    trajectory.leave()
    got = [trajectory.next(here=ROWS[-1] + 0.1) for _ in range(REJOINING)]
    assert trajectory.done and np.array_equal(got[-1], ROWS[-1]) and np.abs(got[0] - ROWS[-1]).max() > 0.09


def test_coming_back_onto_it_takes_as_long_at_any_rate() -> None:
    for dt in (0.005, 0.008, 0.02):
        trajectory = SpeedOverrideTrajectory(ROWS[:1], dt=dt)
        trajectory.leave()
        ticks = 0
        while not trajectory.done:
            trajectory.next(here=ROWS[0] + 0.1)
            ticks += 1
        assert abs(ticks * dt - REJOINING_S) <= dt


SPEED_SHARE_MOST, SPEED_SHARE_CHANGE = np.array([0.01, 0.02, 0.01]), np.array([0.002, 0.002, 0.004])
STEPS = st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3).map(np.array)


def test_a_step_that_is_short_enough_is_taken_whole() -> None:
    assert step_share(SPEED_SHARE_MOST, SPEED_SHARE_MOST, most=SPEED_SHARE_MOST, change=SPEED_SHARE_CHANGE) == 1.0
    assert step_share(np.zeros(3), SPEED_SHARE_MOST, most=SPEED_SHARE_MOST, change=SPEED_SHARE_CHANGE) == 1.0


@given(steps=st.lists(STEPS, min_size=5, max_size=60))
@settings(max_examples=60, deadline=None)
def test_from_rest_no_joint_exceeds_its_speed_by_more_than_one_change(steps: list[FloatArray]) -> None:
    before = np.zeros(3)
    for wish in steps:
        step = before + wish * SPEED_SHARE_CHANGE  # what its servos can
        share = step_share(step, before, most=SPEED_SHARE_MOST, change=SPEED_SHARE_CHANGE)
        assert 0.0 < share <= 1.0
        taken = share * step
        assert (np.abs(taken - before) <= SPEED_SHARE_CHANGE * (1.0 + 1e-9)).all()
        assert (np.abs(taken) <= SPEED_SHARE_MOST + SPEED_SHARE_CHANGE).all()
        before = taken


def test_who_goes_on_and_on_is_at_the_speed_and_not_beyond() -> None:
    before, fastest = np.zeros(3), 0.0
    for _ in range(100):
        step = before + SPEED_SHARE_CHANGE
        before = step_share(step, before, most=SPEED_SHARE_MOST, change=SPEED_SHARE_CHANGE) * step
        fastest = max(fastest, float((before / SPEED_SHARE_MOST).max()))
    assert 0.99 < fastest <= 1.0 + 1e-9


def test_who_was_faster_slows_down_as_fast_as_it_can_and_no_faster() -> None:
    before = np.array([0.02, 0.0, 0.0])
    taken = step_share(before, before, most=SPEED_SHARE_MOST, change=SPEED_SHARE_CHANGE) * before
    assert taken.tolist() == pytest.approx([0.018, 0.0, 0.0])


def test_no_joint_exceeds_its_share_and_it_ends_where_following_begins() -> None:
    robot, s = op3(), np.linspace(0.0, 1.0, 60)[:, None]
    there = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
    present = there - 0.2
    path = there + (s**3 * (10.0 - 15.0 * s + 6.0 * s**2)) * np.linspace(-0.6, 0.6, 20)
    trajectory = approach_trajectory(robot, present, [there, *path], dt=APPROACH_DT)
    got = [present, *(trajectory.next() for _ in range(trajectory.ticks))]
    steps = np.diff(got, axis=0)
    most = robot.profile.safety.speed_caps.approach * robot.joint_map.max_velocity * APPROACH_DT
    assert trajectory.done and np.array_equal(got[-1], path[-1])
    assert (np.abs(steps) <= most * (1.0 + 1e-6)).all() and np.abs(steps / most).max() > 0.9
    assert (np.abs(np.diff(steps, axis=0)) <= robot.joint_map.max_acceleration * APPROACH_DT**2).all()


def test_who_is_there_already_has_no_way() -> None:
    robot = op3()
    there = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
    assert approach_trajectory(robot, there, [there], dt=APPROACH_DT).done


def test_an_approach_that_is_not_finite_is_refused() -> None:
    posture = follower().start(postures(performer())[0])
    require_finite(posture, posture)
    unknown = replace(posture, q=np.full_like(posture.q, np.nan))
    with refuses(RetargetError, 1, 2):
        require_finite(posture, unknown)
