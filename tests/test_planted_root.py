"""The root follows from a sole that stays where it is."""

import numpy as np
import pytest

from retarget.planted_root import plant_root, plant_roots
from retarget.robot_body import load_robot
from retarget.rotations import normalise
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


@pytest.mark.parametrize("name", ["op3", "wolfgang", "toddlerbot"])
def test_one_posture_is_planted_as_many_are(name: str) -> None:
    robot = load_robot(name)
    rng = np.random.default_rng(1)
    before = np.tile(plant(robot, robot.profile.postures.stand).q, (30, 1))
    before[:, :3] += rng.uniform(-1.0, 1.0, (30, 3))
    before[:, 3:7] = normalise(rng.normal(size=(30, 4)))
    before[:, robot.servo_columns] += rng.uniform(-0.3, 0.3, (30, robot.servo_columns.size))
    many = before.copy()
    many[:, robot.servo_columns] += rng.uniform(-0.2, 0.2, (30, robot.servo_columns.size))
    single = many.copy()
    plant_roots(robot, before, many)
    for one, stood in zip(single, before, strict=True):
        plant_root(robot, stood, one)
    np.testing.assert_allclose(single, many, atol=1e-12)
    assert np.abs(many[:, :7] - before[:, :7]).max() > 0.05


def test_a_robot_on_a_stand_keeps_its_root() -> None:
    robot = load_robot("op3", root="fixed")
    before, q = robot.body.qpos0.copy(), robot.body.qpos0 + 0.1
    moved = q.copy()
    plant_root(robot, before, moved)
    np.testing.assert_array_equal(moved, q)
    plant_roots(robot, before[None], moved[None])
    np.testing.assert_array_equal(moved, q)
