"""How far joints give way under load."""

import numpy as np
import pytest

from hardware.servo_lag import full_drive_error, loop_stiffness
from retarget.robot_body import load_robot
from retarget.servo_give import servo_give


def test_a_servo_at_full_drive_is_as_far_off_as_it_gives_way_under_its_stall_torque() -> None:
    robot = load_robot("op3")
    servo = robot.joint_map.servos[0]
    assert servo.gains.position_p is not None
    give = servo_give(robot)
    stalled = full_drive_error(servo.model, float(servo.gains.position_p))
    assert give[0, 0] * servo.model.stall_torque == pytest.approx(stalled)
    assert 1.0 / give[0, 0] == pytest.approx(18.9, abs=0.1)  # N m/rad, as docs/physics.md says
    np.testing.assert_array_equal(give, np.diag(np.diag(give)))


def test_a_gear_makes_a_joint_stiffer_by_its_square() -> None:
    robot = load_robot("toddlerbot")
    servos = robot.joint_map.servos
    row = next(row for row, servo in enumerate(servos) if servo.gear != 1.0 and servo.coupling is None)
    shaft = 1.0 / loop_stiffness(servos[row], protocol=2)
    assert servo_give(robot)[row, row] == pytest.approx(shaft / servos[row].gear ** 2)


def test_coupled_joints_strain_the_shafts_by_what_they_are_strained_by() -> None:
    """Torque times give, in joints, is the sum over both shafts of torque^2 / stiffness: energy is the same in both."""
    robot = load_robot("toddlerbot")
    servos = robot.joint_map.servos
    pair = [row for row, servo in enumerate(servos) if servo.coupling is not None]
    coupling = servos[pair[0]].coupling
    assert coupling is not None and [servos[row].joint for row in pair] == list(coupling.joints)
    stiffness = np.array([loop_stiffness(servos[row], protocol=2) for row in pair])
    joints = np.array([0.3, -0.7])  # [N m]
    shafts = np.array(coupling.matrix).T @ joints  # of equal power
    energy = joints @ servo_give(robot)[np.ix_(pair, pair)] @ joints
    assert energy == pytest.approx(float((shafts**2 / stiffness).sum()))
