"""The limits within which a robot follows."""

from dataclasses import replace

import numpy as np
import pytest

from followers import ROBOTS, op3, shipped, stance
from hardware.servo import loop_lag
from retarget.model.body import JointLimits
from retarget.robot.following_limits import BENT, SLOWEST, followed_speed, following_limits, loaded_speed, soft_limits
from retarget.robot.landmarks import standing_dofs
from retarget.types import FloatArray


def limits(name: str = "op3") -> JointLimits:
    """Those of a robot that stands."""
    return following_limits(shipped(name), stance(name))


@pytest.mark.parametrize("tracking_delay", [0.0, 0.03, 0.1])
def test_a_servo_at_this_speed_stays_within_the_sustained_error(tracking_delay: float) -> None:
    robot, dt = op3(), 1e-4
    safety = robot.profile.safety
    assert safety.planned_lag is not None
    speeds = followed_speed(robot, limits(), tracking_delay=tracking_delay).max_velocity
    for servo in robot.joint_map.servos:
        speed = float(speeds[robot.body.dof_index(servo.joint)])
        delay, share = round((1.0 / safety.rate_hz + tracking_delay) / dt), dt / loop_lag(servo)
        shaft, worst = 0.0, 0.0
        for tick in range(round(0.8 / dt)):
            shaft += share * (speed * max(tick - delay, 0) * dt - shaft)
            worst = max(worst, speed * tick * dt - shaft)
        assert worst == pytest.approx(safety.planned_lag, rel=0.02)


@pytest.mark.parametrize("name", ROBOTS)
def test_planned_lag_limits_the_speed_of_joints_and_nothing_else_does(name: str) -> None:
    """A profile without it keeps the speeds that it had; the threshold of the fault changes none."""
    robot, free = shipped(name), limits(name)
    slow, slower = (followed_speed(robot, free, tracking_delay=delay) for delay in (0.0, 0.03))
    assert (slow.max_velocity <= free.max_velocity).all()
    assert (slower.max_velocity <= slow.max_velocity).all() and (slower.max_velocity[6:] > 0.0).all()
    for part in ("lower", "upper", "max_acceleration"):
        np.testing.assert_array_equal(getattr(slower, part), getattr(free, part))

    def speeds(**safety: float | None) -> FloatArray:
        profile = robot.profile.model_copy(update={"safety": robot.profile.safety.model_copy(update=safety)})
        return followed_speed(replace(robot, profile=profile), free, tracking_delay=0.03).max_velocity

    for threshold in (None, 0.21, 0.34):
        np.testing.assert_array_equal(speeds(following_error_sustained=threshold), slower.max_velocity)
    tight = speeds(planned_lag=0.1)
    assert (tight <= slower.max_velocity).all() and (tight < slower.max_velocity).any()
    np.testing.assert_array_equal(speeds(planned_lag=None), slower.max_velocity)
    np.testing.assert_array_equal(speeds(planned_lag=None, following_error_sustained=None), free.max_velocity)


def test_they_are_those_of_the_servos_but_for_limbs_that_stay_bent() -> None:
    servos, kept, drawn_in = op3().limits, limits(), {}
    for index, joint in enumerate(op3().joint_map.joints):
        dof = op3().body.dof_index(joint)
        assert kept.max_velocity[dof] == servos.max_velocity[index]
        assert kept.max_acceleration[dof] == servos.max_acceleration[index]
        if (kept.lower[dof], kept.upper[dof]) != (servos.lower[index], servos.upper[index]):
            drawn_in[joint] = (kept.lower[dof], kept.upper[dof])
    assert set(drawn_in) == {"l_knee", "r_knee", "l_el", "r_el"}
    assert abs(drawn_in["l_knee"][0] - BENT) < 0.06 and abs(drawn_in["r_knee"][1] + BENT) < 0.06
    assert drawn_in["l_el"][1] < -BENT / 2 and drawn_in["r_el"][0] > BENT / 2


@pytest.mark.parametrize("name", ["op3", "wolfgang", "toddlerbot"])
def test_a_knee_that_carries_is_slower_and_a_head_is_not(name: str) -> None:
    """Every robot keeps some speed."""
    free, loaded = limits(name), loaded_speed(shipped(name), limits(name), speed_margin=0.25)
    if name == "op3":
        for joint, expected in (("l_knee", 3.06), ("r_knee", 3.06), ("head_pan", 4.5), ("l_el", 4.5)):
            assert loaded.max_velocity[op3().body.dof_index(joint)] == pytest.approx(expected, abs=0.03)
    for part in ("lower", "upper", "max_acceleration"):
        np.testing.assert_array_equal(getattr(loaded, part), getattr(free, part))
    ratio = loaded.max_velocity[6:] / free.max_velocity[6:]
    assert SLOWEST <= ratio.min() < 1.0 or np.isclose(ratio, 1.0).all()
    assert ratio.max() == 1.0


def test_legs_keep_off_and_arms_do_not() -> None:
    free, body = limits(), op3().body
    kept = soft_limits(op3(), free, margin=0.05)
    for joint, low, high in (("l_hip_pitch", -2.306194, 0.438692), ("l_ank_roll", -1.346263, 1.346263)):
        dof = body.dof_index(joint)
        assert (kept.lower[dof], kept.upper[dof]) == pytest.approx((low, high))
    knee, arm = body.dof_index("l_knee"), body.dof_index("l_el")
    assert kept.upper[knee] == pytest.approx(2.533087)
    assert kept.lower[knee] == free.lower[knee]  # it is kept bent by more than that already
    assert (kept.lower[arm], kept.upper[arm]) == (free.lower[arm], free.upper[arm])
    for part in ("max_velocity", "max_acceleration"):
        np.testing.assert_array_equal(getattr(kept, part), getattr(free, part))


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("margin", [0.02, 0.05, 0.5])
def test_no_robot_loses_how_it_stands(name: str, margin: float) -> None:
    robot, free = shipped(name), limits(name)
    kept = soft_limits(robot, free, margin=margin)
    assert (kept.lower >= free.lower).all() and (kept.upper <= free.upper).all()
    assert (kept.lower < kept.upper)[6:].all()
    dofs = [robot.body.dof_index(joint) for joint in robot.joint_map.joints]
    posture = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
    inside, was = ((posture >= one.lower[dofs] - 1e-12) & (posture <= one.upper[dofs] + 1e-12) for one in (kept, free))
    assert inside[was].all()
    changed = (kept.lower != free.lower) | (kept.upper != free.upper)
    assert not (changed & ~standing_dofs(robot)).any()
