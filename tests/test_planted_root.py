"""The root follows from a sole that stays where it is."""

import numpy as np

from retarget.planted_root import plant_root
from retarget.robot_body import load_robot
from retarget.stance import plant


def test_the_sole_stays_when_the_joints_move() -> None:
    robot = load_robot("op3")
    before = plant(robot, robot.profile.postures.stand).q
    q = before.copy()
    q[robot.servo_columns] += np.random.default_rng(0).uniform(-0.2, 0.2, 20)
    q[:7] = np.nan
    plant_root(robot, before, q)
    both = np.stack([before, q])
    soles = robot.points(both, ("l_sole", "r_sole"))
    turns = robot.orientations(both, ("l_sole", "r_sole"))
    foot = int(np.argmin(soles[0, :, 2]))
    np.testing.assert_allclose(soles[1, foot], soles[0, foot], atol=1e-12)
    np.testing.assert_allclose(np.abs(np.sum(turns[1, foot] * turns[0, foot])), 1.0, atol=1e-12)


def test_unmoved_joints_leave_the_root() -> None:
    robot = load_robot("op3")
    before = plant(robot, robot.profile.postures.stand).q
    q = before.copy()
    plant_root(robot, before, q)
    np.testing.assert_allclose(q, before, atol=1e-12)
