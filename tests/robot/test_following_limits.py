"""The limits within which a robot follows."""

from dataclasses import replace

import numpy as np
import pytest

from followers import op3
from hardware.servo import loop_lag
from retarget.ik.support_polygon import plant
from retarget.model.body import JointLimits
from retarget.model.robot import RobotBody, load_robot
from retarget.robot.following_limits import (
    BENT,
    SLOWEST,
    followed_speed,
    following_limits,
    loaded_speed,
    soft_limits,
)
from retarget.robot.landmarks import standing_dofs
from retarget.types import FloatArray


def limits(robot: RobotBody | None = None) -> JointLimits:
    """OP3's, or of another robot that stands."""
    robot = robot or op3()
    return following_limits(robot, plant(robot, robot.profile.postures.stand))


@pytest.mark.parametrize("tracking_delay", [0.0, 0.03, 0.1])
def test_a_servo_at_this_speed_stays_within_the_sustained_error(tracking_delay: float) -> None:
    robot, dt = op3(), 1e-4
    safety = robot.profile.safety
    assert safety.planned_lag is not None
    speeds = followed_speed(robot, limits(robot), tracking_delay=tracking_delay).max_velocity
    for servo in robot.joint_map.servos:
        speed = float(speeds[robot.body.dof_index(servo.joint)])
        delay, share = round((1.0 / safety.rate_hz + tracking_delay) / dt), dt / loop_lag(servo)
        shaft, worst = 0.0, 0.0
        for tick in range(round(0.8 / dt)):
            shaft += share * (speed * max(tick - delay, 0) * dt - shaft)
            worst = max(worst, speed * tick * dt - shaft)
        assert worst == pytest.approx(safety.planned_lag, rel=0.02)


def with_safety(robot: RobotBody, **keys: float | None) -> RobotBody:
    """The robot with other bounds in `safety`."""
    profile = robot.profile
    safety = profile.safety.model_copy(update=keys)
    return replace(robot, profile=profile.model_copy(update={"safety": safety}))


def speeds(robot: RobotBody) -> FloatArray:
    return followed_speed(robot, limits(robot), tracking_delay=0.03).max_velocity


@pytest.mark.parametrize("name", ["op3", "wolfgang", "toddlerbot", "poppy"])
def test_the_threshold_of_the_fault_changes_no_planned_speed(name: str) -> None:
    robot = load_robot(name)
    for threshold in (None, 0.21, 0.34):
        np.testing.assert_array_equal(speeds(with_safety(robot, following_error_sustained=threshold)), speeds(robot))
    slower = with_safety(robot, planned_lag=0.1)
    assert (speeds(slower) <= speeds(robot)).all() and (speeds(slower) < speeds(robot)).any()


@pytest.mark.parametrize("name", ["op3", "wolfgang", "toddlerbot", "poppy"])
def test_a_profile_without_planned_lag_keeps_the_speeds_that_it_had(name: str) -> None:
    robot = load_robot(name)
    older = with_safety(robot, planned_lag=None)
    np.testing.assert_array_equal(speeds(older), speeds(robot))
    neither = with_safety(older, following_error_sustained=None)
    np.testing.assert_array_equal(speeds(neither), limits(robot).max_velocity)


def test_no_joint_gets_faster_and_nothing_else_changes() -> None:
    for name in ("op3", "wolfgang", "toddlerbot", "poppy"):
        robot = load_robot(name)
        free = limits(robot)
        slow, slower = (followed_speed(robot, free, tracking_delay=tracking_delay) for tracking_delay in (0.0, 0.03))
        assert (slow.max_velocity <= free.max_velocity).all()
        assert (slower.max_velocity <= slow.max_velocity).all() and (slower.max_velocity[6:] > 0.0).all()
        for part in ("lower", "upper", "max_acceleration"):
            np.testing.assert_array_equal(getattr(slower, part), getattr(free, part))


def test_they_are_those_of_the_servos_but_for_limbs_that_stay_bent() -> None:
    body, servos = op3().body, op3().limits
    kept, drawn_in = limits(), {}
    for index, joint in enumerate(op3().joint_map.joints):
        dof = body.dof_index(joint)
        assert kept.max_velocity[dof] == servos.max_velocity[index]
        assert kept.max_acceleration[dof] == servos.max_acceleration[index]
        if (kept.lower[dof], kept.upper[dof]) != (servos.lower[index], servos.upper[index]):
            drawn_in[joint] = (kept.lower[dof], kept.upper[dof])
    assert set(drawn_in) == {"l_knee", "r_knee", "l_el", "r_el"}
    assert abs(drawn_in["l_knee"][0] - BENT) < 0.06 and abs(drawn_in["r_knee"][1] + BENT) < 0.06
    assert drawn_in["l_el"][1] < -BENT / 2 and drawn_in["r_el"][0] > BENT / 2


def test_a_knee_that_carries_is_slower_and_a_head_is_not() -> None:
    free, loaded = limits(), loaded_speed(op3(), limits(), speed_margin=0.25)
    for joint, expected in (("l_knee", 3.06), ("r_knee", 3.06), ("head_pan", 4.5), ("l_el", 4.5)):
        assert loaded.max_velocity[op3().body.dof_index(joint)] == pytest.approx(expected, abs=0.03)
    assert (loaded.max_velocity <= free.max_velocity).all()
    for name in ("lower", "upper", "max_acceleration"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(free, name))


@pytest.mark.parametrize("name", ["wolfgang", "toddlerbot"])
def test_every_robot_keeps_some_speed(name: str) -> None:
    robot = load_robot(name)
    free = limits(robot)
    loaded = loaded_speed(robot, free, speed_margin=0.25)
    ratio = loaded.max_velocity[6:] / free.max_velocity[6:]
    assert SLOWEST <= ratio.min() < 1.0 or np.isclose(ratio, 1.0).all()
    assert ratio.max() == 1.0


def test_legs_keep_off_and_arms_do_not() -> None:
    free = limits()
    kept = soft_limits(op3(), free, margin=0.05)
    body = op3().body
    for joint, low, high in (("l_hip_pitch", -2.306194, 0.438692), ("l_ank_roll", -1.346263, 1.346263)):
        dof = body.dof_index(joint)
        assert (kept.lower[dof], kept.upper[dof]) == pytest.approx((low, high))
    knee = body.dof_index("l_knee")
    assert kept.upper[knee] == pytest.approx(2.533087)
    assert kept.lower[knee] == free.lower[knee]  # it is kept bent by more than that already
    arm = body.dof_index("l_el")
    assert (kept.lower[arm], kept.upper[arm]) == (free.lower[arm], free.upper[arm])
    for name in ("max_velocity", "max_acceleration"):
        np.testing.assert_array_equal(getattr(kept, name), getattr(free, name))


@pytest.mark.parametrize("name", ["op3", "wolfgang", "toddlerbot", "poppy"])
@pytest.mark.parametrize("margin", [0.02, 0.05, 0.5])
def test_no_robot_loses_how_it_stands(name: str, margin: float) -> None:
    robot = load_robot(name)
    free = limits(robot)
    kept = soft_limits(robot, free, margin=margin)
    assert (kept.lower >= free.lower).all() and (kept.upper <= free.upper).all()
    assert (kept.lower < kept.upper)[6:].all()
    dofs = [robot.body.dof_index(joint) for joint in robot.joint_map.joints]
    posture = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
    inside = (posture >= kept.lower[dofs] - 1e-12) & (posture <= kept.upper[dofs] + 1e-12)
    was = (posture >= free.lower[dofs] - 1e-12) & (posture <= free.upper[dofs] + 1e-12)
    assert inside[was].all()
    changed = (kept.lower != free.lower) | (kept.upper != free.upper)
    assert not (changed & ~standing_dofs(robot)).any()
