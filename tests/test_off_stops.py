"""Joints that carry a robot keep off the ends of their range."""

import numpy as np
import pytest

from followers import op3
from retarget.following_limits import following_limits
from retarget.joint_limits import JointLimits
from retarget.off_stops import off_stops
from retarget.robot_body import RobotBody, load_robot
from retarget.robot_reader import standing_dofs
from retarget.stance import plant


def limits(robot: RobotBody) -> JointLimits:
    return following_limits(robot, plant(robot, robot.profile.postures.stand))


def test_legs_keep_off_and_arms_do_not() -> None:
    free = limits(op3())
    kept = off_stops(op3(), free, margin=0.05)
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
    kept = off_stops(robot, free, margin=margin)
    assert (kept.lower >= free.lower).all() and (kept.upper <= free.upper).all()
    assert (kept.lower < kept.upper)[6:].all()
    dofs = [robot.body.dof_index(joint) for joint in robot.joint_map.joints]
    posture = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
    inside = (posture >= kept.lower[dofs] - 1e-12) & (posture <= kept.upper[dofs] + 1e-12)
    was = (posture >= free.lower[dofs] - 1e-12) & (posture <= free.upper[dofs] + 1e-12)
    assert inside[was].all()
    changed = (kept.lower != free.lower) | (kept.upper != free.upper)
    assert not (changed & ~standing_dofs(robot)).any()


def test_nothing_to_keep_off_is_nothing() -> None:
    free = limits(op3())
    assert off_stops(op3(), free, margin=0.0) is free
    hanging = load_robot("op3", root="fixed")
    assert off_stops(hanging, free, margin=0.05) is free
