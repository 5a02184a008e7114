"""The way to where following begins: smooth, slow, and exactly there in the end."""

import numpy as np

from retarget.approach import approach
from retarget.joint_limits import JointLimits
from retarget.metrics.motion import limit_violations
from retarget.robot_body import load_robot

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
