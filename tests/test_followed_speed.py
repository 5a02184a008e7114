"""Joints are planned no faster than the guard takes a servo that follows for one that is stuck."""

from dataclasses import replace

import numpy as np
import pytest

from followers import op3
from hardware.servo_lag import loop_lag
from retarget.followed_speed import SHARE, followed_speed
from retarget.following_limits import following_limits
from retarget.joint_limits import JointLimits
from retarget.robot_body import RobotBody, load_robot
from retarget.stance import plant


def limits(robot: RobotBody) -> JointLimits:
    return following_limits(robot, plant(robot, robot.profile.postures.stand))


@pytest.mark.parametrize("late", [0.0, 0.03, 0.1])
def test_a_servo_at_this_speed_stays_within_the_error_that_lasts(late: float) -> None:
    robot, dt = op3(), 1e-4
    safety = robot.profile.safety
    assert safety.following_error_lasting is not None
    speeds = followed_speed(robot, limits(robot), late=late).max_velocity
    for servo in robot.joint_map.servos:
        speed = float(speeds[robot.body.dof_index(servo.joint)])
        delay, share = round((1.0 / safety.rate_hz + late) / dt), dt / loop_lag(servo)
        shaft, worst = 0.0, 0.0
        for tick in range(round(0.8 / dt)):
            shaft += share * (speed * max(tick - delay, 0) * dt - shaft)
            worst = max(worst, speed * tick * dt - shaft)
        assert worst == pytest.approx(SHARE * safety.following_error_lasting, rel=0.02)


def test_no_joint_gets_faster_and_nothing_else_changes() -> None:
    for name in ("op3", "wolfgang", "toddlerbot", "poppy"):
        robot = load_robot(name)
        free = limits(robot)
        slow, slower = (followed_speed(robot, free, late=late) for late in (0.0, 0.03))
        assert (slow.max_velocity <= free.max_velocity).all()
        assert (slower.max_velocity <= slow.max_velocity).all() and (slower.max_velocity[6:] > 0.0).all()
        for part in ("lower", "upper", "max_acceleration"):
            np.testing.assert_array_equal(getattr(slower, part), getattr(free, part))


def test_a_profile_without_that_bound_keeps_its_speeds() -> None:
    robot = load_robot("op3")
    safety = robot.profile.safety.model_copy(update={"following_error_lasting": None})
    unwatched = replace(robot, profile=robot.profile.model_copy(update={"safety": safety}))
    free = limits(robot)
    assert followed_speed(unwatched, free, late=0.03) is free
