"""What joints carry, against the engine's inverse dynamics."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from followers import op3
from hardware.servo import loop_stiffness
from retarget.ik.base_pose import plant_root
from retarget.ik.gravity_torque import GravityTorque, joint_compliance
from retarget.ik.support_polygon import Stance, plant
from retarget.model.robot import load_robot
from retarget.types import FloatArray

WEIGHT = op3().body.total_mass * 9.81


def standing() -> Stance:
    return plant(op3(), op3().profile.postures.stand)


def posture(arms: float, crouch: float) -> FloatArray:
    """A posture (nq,) on both soles: arms raised by `arms` rad, hips, knees and ankles bent further by `crouch`."""
    angles = dict(op3().profile.postures.stand)
    for side, sign in (("l", 1.0), ("r", -1.0)):
        angles[f"{side}_sho_roll"] += sign * arms
        angles[f"{side}_hip_pitch"] -= sign * crouch
        angles[f"{side}_knee"] += sign * 2.0 * crouch
        angles[f"{side}_ank_pitch"] += sign * crouch
    q = op3().posture(angles)
    plant_root(op3(), standing().q, q)
    return q


def by_inverse_dynamics(q: FloatArray, pressed: FloatArray) -> FloatArray:
    """Torques (nv,) that hold the robot at rest while its soles carry their shares, by MuJoCo's own statics."""
    model = mujoco.MjModel.from_xml_path(str(op3().profile.body_path))
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    torque = data.qfrc_bias.copy()
    soles = standing().soles
    left, right = (sole.outline.mean(axis=0) for sole in soles)
    share = (pressed - left) @ (right - left) / ((right - left) @ (right - left))
    across = pressed - left - share * (right - left)
    for sole, middle, part in ((soles[0], left, 1.0 - share), (soles[1], right, share)):
        force = np.zeros(model.nv)
        at = np.array([*(middle + across), 0.0])
        mujoco.mj_applyFT(model, data, np.array([0.0, 0.0, part * WEIGHT]), np.zeros(3), at, sole.frame.body, force)
        torque -= force
    return np.asarray(torque)


@settings(max_examples=15, deadline=None)
@given(st.floats(-0.3, 0.4), st.floats(-0.1, 0.35))
def test_at_rest_it_is_what_statics_say(arms: float, crouch: float) -> None:
    q = posture(arms, crouch)
    com = op3().body.solver_body().centre_of_mass(q[None])[0]
    torque = GravityTorque(op3(), standing()).torques(q, np.zeros(3))
    np.testing.assert_allclose(torque, by_inverse_dynamics(q, com[:2]), atol=1e-6)
    assert np.abs(torque[:6]).max() < 1e-9 and np.abs(torque[6:]).max() > 0.2


@pytest.mark.parametrize("name", ["op3", "wolfgang", "toddlerbot"])
def test_the_root_of_a_robot_that_stands_asks_for_nothing(name: str) -> None:
    robot = load_robot(name)
    stance = plant(robot, robot.profile.postures.stand)
    load = GravityTorque(robot, stance)
    for push in ([0.0, 0.0, 0.0], [0.3, -0.2, 0.0], [0.0, 0.4, -2.0]):
        torque = load.torques(stance.q, np.array(push))
        # What is not balanced: the soles' middles are not quite at one height in a posture that is taken as flat.
        assert np.abs(torque[:6]).max() < 1e-6 * robot.body.total_mass * 9.81 + 1e-9, push


def test_a_servo_gives_way_by_torque_over_the_stiffness_of_its_model() -> None:
    robot = load_robot("op3")
    servo = robot.joint_map.servos[0]
    give = joint_compliance(robot)
    assert 1.0 / give[0, 0] == pytest.approx(loop_stiffness(servo)) == pytest.approx(18.9, abs=0.1)  # N m/rad, docs
    np.testing.assert_array_equal(give, np.diag(np.diag(give)))


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
    energy = joints @ joint_compliance(robot)[np.ix_(pair, pair)] @ joints
    assert energy == pytest.approx(float((shafts**2 / stiffness).sum()))
