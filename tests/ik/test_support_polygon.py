"""Where a robot stands."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from followers import ROBOTS, op3, shipped, stance
from hardware.servo import loop_stiffness
from retarget import rotations
from retarget.errors import ConfigError
from retarget.ik.gravity_torque import GravityTorque, joint_compliance
from retarget.ik.support_polygon import check_stand, convex_hull, plant, support_distance, support_edges
from retarget.model.robot import RobotBody, plant_root
from retarget.robot.landmarks import standing_dofs
from retarget.types import FloatArray


def test_a_posture_is_put_upright_on_its_soles() -> None:
    leans = plant(op3(), op3().profile.postures.stand | {"l_ank_pitch": 0.6, "r_ank_pitch": -0.6})
    up = rotations.rotate(op3().orientations(leans.q[None], ("l_sole", "r_sole"))[0], np.array([0.0, 0.0, 1.0]))
    assert np.allclose(up, [0.0, 0.0, 1.0], atol=1e-9)
    assert abs(leans.points["l_sole"][2]) < 1e-9
    for sole in stance().soles:
        links = [sole.frame.body] * len(sole.corners)
        corners = op3().kinematics.points(stance().q[None], links, sole.corners)[0]
        assert np.allclose(corners, np.insert(sole.outline, 2, 0.0, axis=1), atol=1e-9)


def leaning(degrees: float) -> RobotBody:
    """OP3 that leans forward from its ankles in posture `stand`."""
    stand = dict(op3().profile.postures.stand)
    for joint, sign in (("l_ank_pitch", 1.0), ("r_ank_pitch", -1.0)):
        stand[joint] = stand.get(joint, 0.0) + sign * np.radians(degrees)
    postures = op3().profile.postures.model_copy(update={"stand": stand})
    return replace(op3(), profile=op3().profile.model_copy(update={"postures": postures}))


@pytest.mark.parametrize("name", ROBOTS)
def test_shipped_robots_stand(name: str) -> None:
    margin = check_stand(shipped(name))
    assert margin is not None and margin > 0.01


def test_the_message_of_a_stand_that_falls_shows_the_centre_of_mass() -> None:
    margins = [check_stand(leaning(degrees)) for degrees in (0.0, 5.0, 10.0)]
    assert len({round(1e3 * (margin or 0.0)) for margin in margins}) == 3
    worst = max((-30.0, 30.0), key=lambda degrees: degrees if margins[2] < margins[0] else -degrees)  # type: ignore[operator]
    with pytest.raises(ConfigError) as caught:
        check_stand(leaning(worst))
    for text in ("postures.stand", "centre of mass at (", "mm outside the soles", "inside (", "Lean the robot"):
        assert text in str(caught.value)


COORDINATES = st.floats(-1.0, 1.0).map(lambda value: round(value, 3))
POINTS = st.lists(st.tuples(COORDINATES, COORDINATES), min_size=6, max_size=20, unique=True).map(np.array)


@given(POINTS)
def test_a_hull_is_counter_clockwise_and_holds_every_point(points: np.ndarray) -> None:
    x, y = convex_hull(points).T
    if len(x) > 2 and 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) > 1e-3:
        edges = support_edges([points])
        assert np.allclose(np.linalg.norm(edges[:, :2], axis=1), 1.0)
        assert support_distance(points, edges).min() > -1e-9


def test_distance_is_that_to_the_nearest_edge() -> None:
    edges = support_edges([np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])])
    points = np.array([[0.5, 0.5, 9.0], [0.9, 0.5, 9.0], [1.2, 0.5, 9.0]])
    assert np.allclose(support_distance(points, edges), [0.5, 0.1, -0.2])
    assert np.allclose(support_distance(points[None], edges), [[0.5, 0.1, -0.2]])


# What joints carry, against the engine's inverse dynamics.

HELD = np.array([0.0, 0.0, op3().body.total_mass * 9.81])
"""What the ground carries of a robot at rest, N."""


def posture(arms: float, crouch: float) -> FloatArray:
    """A posture (nq,) on both soles: arms raised by `arms` rad, hips, knees and ankles bent further by `crouch`."""
    angles = dict(op3().profile.postures.stand)
    for side, sign in (("l", 1.0), ("r", -1.0)):
        angles[f"{side}_sho_roll"] += sign * arms
        angles[f"{side}_hip_pitch"] -= sign * crouch
        angles[f"{side}_knee"] += sign * 2.0 * crouch
        angles[f"{side}_ank_pitch"] += sign * crouch
    q = op3().posture(angles)
    plant_root(op3(), stance().q, q)
    return q


def by_inverse_dynamics(
    q: FloatArray, pressed: FloatArray, force: FloatArray = HELD, inertial: FloatArray | float = 0.0
) -> FloatArray:
    """Torques (nv,) by MuJoCo while the soles carry their shares of a force (3,) N at `pressed` (2,) m. inertial (nv,):
    what accelerates the robot, which does not move yet."""
    model = mujoco.MjModel.from_xml_path(str(op3().profile.body_path))
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    torque = data.qfrc_bias + inertial
    soles = stance().soles
    left, right = (sole.outline.mean(axis=0) for sole in soles)
    share = (pressed - left) @ (right - left) / ((right - left) @ (right - left))
    across = pressed - left - share * (right - left)
    for sole, middle, part in ((soles[0], left, 1.0 - share), (soles[1], right, share)):
        carried = np.zeros(model.nv)
        at = np.array([*(middle + across), 0.0])
        mujoco.mj_applyFT(model, data, part * force, np.zeros(3), at, sole.frame.body, carried)
        torque -= carried
    return np.asarray(torque)


@settings(max_examples=15, deadline=None)
@given(st.floats(-0.3, 0.4), st.floats(-0.1, 0.35))
def test_at_rest_it_is_what_statics_say(arms: float, crouch: float) -> None:
    q = posture(arms, crouch)
    com = op3().kinematics.centre_of_mass(q[None])[0]
    torque = GravityTorque(op3(), stance()).torques(q, np.zeros(3))
    np.testing.assert_allclose(torque, by_inverse_dynamics(q, com[:2]), atol=1e-6)
    assert np.abs(torque[:6]).max() < 1e-9 and np.abs(torque[6:]).max() > 0.2


@pytest.mark.parametrize("joints", [("l_sho_pitch",), ("l_sho_pitch", "r_sho_roll", "l_el")])
def test_arms_that_speed_up_load_the_legs_as_inverse_dynamics_say(joints: tuple[str, ...]) -> None:
    """By the acceleration of the mass and the rate of the angular momentum about it; legs do not move."""
    model = mujoco.MjModel.from_xml_path(str(op3().profile.body_path))
    data, q = mujoco.MjData(model), posture(0.3, 0.2)
    data.qpos[:] = q
    data.qacc[[op3().body.dof_index(joint) for joint in joints]] = 40.0
    asked = data.qacc.copy()
    mujoco.mj_forward(model, data)
    inertial = np.zeros(model.nv)
    mujoco.mj_mulM(model, data, inertial, asked)
    acceleration = op3().kinematics.centre_of_mass_jacobian(q) @ asked
    data.qvel[:] = asked  # from rest, the momentum after a second of it is its rate
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    moment = data.subtree_angmom[0].copy()
    com, force = data.subtree_com[0].copy(), op3().body.total_mass * (acceleration + np.array([0.0, 0.0, 9.81]))
    # Where the ground carries the root's whole wrench but for a turn about the vertical.
    pressed = com[:2] - (com[2] * force[:2] + np.array([moment[1], -moment[0]])) / force[2]
    torque = by_inverse_dynamics(q, pressed, force, inertial)
    turn = rotations.rotate(q[3:7], torque[3:6])
    assert np.abs([*torque[:3], *turn[:2]]).max() < 1e-6, "the root is carried, but for a turn about the vertical"
    found = GravityTorque(op3(), stance()).torques(q, acceleration, moment=moment[:2])
    legs = np.flatnonzero(standing_dofs(op3()))[6:]
    without = GravityTorque(op3(), stance()).torques(q, acceleration)
    ankles = [op3().body.dof_index(f"{side}_ank_{way}") for side in "lr" for way in ("pitch", "roll")]
    off, blind = (np.abs(load - torque) for load in (found, without))
    assert off[legs].max() < 0.02  # above the ankles, legs are taken to be accelerated with the mass
    assert off[ankles].max() < 5e-4 < 2e-3 < blind[ankles].max()


@pytest.mark.parametrize("name", ["op3", "wolfgang", "toddlerbot"])
def test_the_root_of_a_robot_that_stands_needs_no_torque(name: str) -> None:
    load = GravityTorque(shipped(name), stance(name))
    for push in ([0.0, 0.0, 0.0], [0.3, -0.2, 0.0], [0.0, 0.4, -2.0]):
        torque = load.torques(stance(name).q, np.array(push))
        # What is not balanced: the soles' middles are not quite at one height in a posture that is taken as flat.
        assert np.abs(torque[:6]).max() < 1e-6 * shipped(name).body.total_mass * 9.81 + 1e-9, push


def test_compliance_is_that_of_servos_and_coupled_joints_strain_the_shafts_by_what_they_are_strained_by() -> None:
    """Torque times compliance, in joints, is the sum over both shafts of torque^2 / stiffness: energy is the same."""
    compliance = joint_compliance(op3())
    stiffness = loop_stiffness(op3().joint_map.servos[0])
    assert 1.0 / compliance[0, 0] == pytest.approx(stiffness) == pytest.approx(18.9, abs=0.1)  # N m/rad, docs
    np.testing.assert_array_equal(compliance, np.diag(np.diag(compliance)))
    robot = shipped("toddlerbot")
    servos = robot.joint_map.servos
    pair = [row for row, servo in enumerate(servos) if servo.coupling is not None]
    coupling = servos[pair[0]].coupling
    assert coupling is not None and [servos[row].joint for row in pair] == list(coupling.joints)
    joints = np.array([0.3, -0.7])  # [N m]
    shafts = np.array(coupling.matrix).T @ joints  # of equal power
    energy = joints @ joint_compliance(robot)[np.ix_(pair, pair)] @ joints
    assert energy == pytest.approx(float((shafts**2 / [loop_stiffness(servos[row]) for row in pair]).sum()))
