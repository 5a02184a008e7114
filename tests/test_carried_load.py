"""What joints carry, against the engine's inverse dynamics."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from followers import op3
from retarget.carried_load import CarriedLoad
from retarget.planted_root import plant_root
from retarget.robot_body import load_robot
from retarget.rotations import FloatArray
from retarget.stance import Stance, plant

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
    beside = pressed - left - share * (right - left)
    for sole, middle, part in ((soles[0], left, 1.0 - share), (soles[1], right, share)):
        force = np.zeros(model.nv)
        at = np.array([*(middle + beside), 0.0])
        mujoco.mj_applyFT(model, data, np.array([0.0, 0.0, part * WEIGHT]), np.zeros(3), at, sole.frame.body, force)
        torque -= force
    return np.asarray(torque)


@settings(max_examples=15, deadline=None)
@given(st.floats(-0.3, 0.4), st.floats(-0.1, 0.35))
def test_at_rest_it_is_what_statics_say(arms: float, crouch: float) -> None:
    q = posture(arms, crouch)
    com = op3().body.solver_body().centre_of_mass(q[None])[0]
    torque = CarriedLoad(op3(), standing()).torques(q, np.zeros(3))
    np.testing.assert_allclose(torque, by_inverse_dynamics(q, com[:2]), atol=1e-6)
    assert np.abs(torque[:6]).max() < 1e-9 and np.abs(torque[6:]).max() > 0.2


@pytest.mark.parametrize("name", ["op3", "wolfgang", "toddlerbot"])
def test_the_root_of_a_robot_that_stands_asks_for_nothing(name: str) -> None:
    robot = load_robot(name)
    stance = plant(robot, robot.profile.postures.stand)
    load = CarriedLoad(robot, stance)
    for push in ([0.0, 0.0, 0.0], [0.3, -0.2, 0.0], [0.0, 0.4, -2.0]):
        torque = load.torques(stance.q, np.array(push))
        # What is not balanced: the soles' middles are not quite at one height in a posture that is taken as flat.
        assert np.abs(torque[:6]).max() < 1e-6 * robot.body.total_mass * 9.81 + 1e-9, push


def test_who_falls_freely_carries_nothing() -> None:
    q = posture(0.1, 0.2)
    torque = CarriedLoad(op3(), standing()).torques(q, np.array([0.0, 0.0, -9.81 * (1.0 - 1e-9)]))
    assert np.abs(torque).max() < 1e-6


def test_who_leans_to_one_side_carries_it_with_that_leg() -> None:
    stance = standing()
    left = op3().body.dof_index("l_knee")
    right = op3().body.dof_index("r_knee")
    load = CarriedLoad(op3(), stance)
    # To the right, so that the soles press on the left.
    torque = load.torques(stance.q, np.array([0.0, -1.5, 0.0]))
    assert abs(torque[left]) > 2.0 * abs(torque[right]) > 0.0
    # Beyond the sole no more than the leg's own mass is left: a sole does not pull.
    beyond, further = (load.torques(stance.q, np.array([0.0, push, 0.0]))[right] for push in (-4.0, -5.0))
    assert abs(beyond) < 0.4 * abs(load.torques(stance.q, np.zeros(3))[right])
    assert abs(further - beyond) < 0.05
