"""Joints that carry a robot are planned no faster than their motors turn under it."""

from dataclasses import replace

import numpy as np
import pytest

from followers import op3
from retarget.following_limits import following_limits
from retarget.joint_limits import JointLimits
from retarget.loaded_speed import SLOWEST, loaded_speed
from retarget.robot_body import load_robot
from retarget.stance import plant

BODY = op3().body


def limits() -> JointLimits:
    return following_limits(op3(), plant(op3(), op3().profile.postures.stand))


def test_a_knee_that_carries_is_slower_and_a_head_is_not() -> None:
    free, loaded = limits(), loaded_speed(op3(), limits(), reserve=0.25)
    for joint, expected in (("l_knee", 3.06), ("r_knee", 3.06), ("head_pan", 4.5), ("l_el", 4.5)):
        assert loaded.max_velocity[BODY.dof_index(joint)] == pytest.approx(expected, abs=0.03)
    assert (loaded.max_velocity <= free.max_velocity).all()
    for name in ("lower", "upper", "max_acceleration"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(free, name))


def test_more_reserve_is_slower_down_to_a_share() -> None:
    knee = BODY.dof_index("l_knee")
    speeds = [float(loaded_speed(op3(), limits(), reserve=reserve).max_velocity[knee]) for reserve in (0.0, 0.5, 99.0)]
    servo = next(servo for servo in op3().joint_map.servos if servo.joint == "l_knee")
    assert speeds[0] > speeds[1] > speeds[2] == pytest.approx(SLOWEST * servo.model.no_load_speed)


def test_who_does_not_stand_keeps_its_limits() -> None:
    hanging = load_robot("op3", root="fixed")
    free = replace(limits())
    assert loaded_speed(hanging, free, reserve=0.25) is free


@pytest.mark.parametrize("name", ["wolfgang", "toddlerbot"])
def test_every_robot_keeps_some_speed(name: str) -> None:
    robot = load_robot(name)
    free = following_limits(robot, plant(robot, robot.profile.postures.stand))
    loaded = loaded_speed(robot, free, reserve=0.25)
    ratio = loaded.max_velocity[6:] / free.max_velocity[6:]
    assert SLOWEST <= ratio.min() < 1.0 or np.isclose(ratio, 1.0).all()
    assert ratio.max() == 1.0
