"""Goals of a walking robot: torques beside MuJoCo's inverse dynamics, bounds of offsets, and which way feedback
pushes."""

from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest

from followers import op3
from hardware.imu import ImuSample
from retarget.ik.support_polygon import Stance, plant
from retarget.robot.deflection_compensation import DeflectionCompensation
from retarget.robot.walking.gait import gait_of
from retarget.robot.walking.walking_goals import MOST_WALKING_RAD, Feedback, WalkDynamics, WalkingGoals
from retarget.types import FloatArray
from sim.physics.mount import mount_of
from sim.physics.perturbation import NOMINAL
from sim.physics.world import build_world

DT = 0.008
JOINTS = op3().joint_map.joints


@cache
def stance() -> Stance:
    return plant(op3(), op3().profile.postures.stand)


def goals() -> WalkingGoals:
    standing = DeflectionCompensation(op3(), stance(), dt=DT, settle=0.02)
    return WalkingGoals(op3(), stance(), standing, gait_of(op3(), stance(), dt=DT))


def stand() -> FloatArray:
    return stance().q[op3().servo_columns]


@cache
def model() -> Any:
    return build_world(op3(), stand(), mount=mount_of(op3()), perturbation=NOMINAL).model


def needed(q: FloatArray, velocity: FloatArray, acceleration: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Torques (n,) of joints and force and moment (6,) on the root, by MuJoCo without contact, armature and damping."""
    data, one = mujoco.MjData(model()), model()
    joints = [one.joint(name) for name in JOINTS]
    places = [int(joint.qposadr[0]) for joint in joints]
    data.qpos[:7], data.qpos[places] = q[:7], q[op3().servo_columns]
    data.qvel[:], data.qacc[:] = velocity, acceleration
    mujoco.mj_kinematics(one, data)
    mujoco.mj_comPos(one, data)
    mujoco.mj_comVel(one, data)
    found = np.zeros(one.nv)
    mujoco.mj_rne(one, data, 1, found)
    return found[[int(joint.dofadr[0]) for joint in joints]], found[:6]


@pytest.mark.parametrize("seed", range(5))
def test_torques_of_limbs_are_those_of_inverse_dynamics(seed: int) -> None:
    """Arms and head carry nothing from the floor: what they need is what MuJoCo says, up to the turning of links."""
    chance = np.random.default_rng(seed)
    q = stance().q.copy()
    q[op3().servo_columns] += chance.uniform(-0.3, 0.3, len(JOINTS))
    seen = WalkDynamics(op3(), stance())
    acceleration = np.zeros(op3().body.nv)
    limbs = [row for row, name in enumerate(JOINTS) if "sho" in name or "el" in name]
    dofs = [op3().body.dof_index(JOINTS[row]) for row in limbs]
    acceleration[dofs] = chance.uniform(-20.0, 20.0, len(dofs))
    dt, body = 1e-4, op3().kinematics
    after, before = (body.integrate(q, sign * 0.5 * dt * dt * acceleration) for sign in (1.0, 1.0))
    places = seen.look(q).masses
    masses = (seen.look(after).masses + seen.look(before).masses - 2.0 * places) / (dt * dt)
    torque, _ = seen.torques(seen.look(q), masses)
    joints = np.zeros(model().nv)
    joints[[int(model().joint(JOINTS[row]).dofadr[0]) for row in limbs]] = acceleration[dofs]
    wanted, _ = needed(q, np.zeros(model().nv), joints)
    np.testing.assert_allclose(torque[limbs], wanted[limbs], atol=0.02)


def test_at_rest_the_legs_carry_the_weight() -> None:
    seen = WalkDynamics(op3(), stance())
    look = seen.look(stance().q)
    torque, shares = seen.torques(look, np.zeros_like(look.masses))
    com = op3().kinematics.centre_of_mass(stance().q[None])[0]
    assert shares.sum() == pytest.approx(1.0) and abs(shares[0] - 0.5) < 0.02
    wanted = DeflectionCompensation(op3(), stance(), dt=DT, settle=0.02)._load.torques(stance().q, np.zeros(3))
    dofs = [op3().body.dof_index(joint) for joint in JOINTS]
    np.testing.assert_allclose(torque, wanted[dofs], atol=0.01)
    assert com[2] > 0.2


def test_the_foot_under_the_mass_carries_alone() -> None:
    seen, q = WalkDynamics(op3(), stance()), stance().q.copy()
    q[1] += 0.0  # the mass moves, the soles stay: a whole body that is pushed sideways
    look = seen.look(q)
    aside = np.zeros_like(look.masses)
    aside[:, 1] = -5.0  # m/s^2 to the right: the soles push to the right, the left one more
    _, shares = seen.torques(look, aside)
    assert shares.tolist() == [1.0, 0.0]


@pytest.mark.parametrize("seed", range(5))
def test_offsets_have_bounds_whatever_is_asked(seed: int) -> None:
    chance, one = np.random.default_rng(seed), goals()
    state, posture, limits = one.begin(stand()), stand(), op3().limits
    for _ in range(60):
        posture = np.clip(posture + chance.normal(0.0, 0.1, len(posture)), limits.lower, limits.upper)
        goal, state = one.propose(
            state, posture, lambda goal: goal, ahead=posture + chance.normal(0.0, 0.1, 20), walks=True
        )
        assert state.free and (np.abs(goal - posture) <= MOST_WALKING_RAD + 1e-12).all()
        assert (goal >= limits.lower - 1e-12).all() and (goal <= limits.upper + 1e-12).all()


def test_a_robot_that_stands_again_is_held_from_where_it_was() -> None:
    one = goals()
    state = one.begin(stand())
    for _ in range(50):
        goal, state = one.propose(state, stand(), lambda goal: goal, ahead=stand(), walks=True)
    walked = goal - stand()
    assert np.abs(walked).max() > 0.01, "it carries its weight"
    goal, state = one.propose(state, stand(), lambda goal: goal, ahead=stand(), walks=None)
    assert state.free, "on the rest of its path"
    for _ in range(400):
        before = goal
        goal, state = one.propose(state, stand(), lambda goal: goal, ahead=stand(), walks=False)
        assert not state.free and np.abs(goal - before).max() < 0.02
    np.testing.assert_allclose(goal - stand(), walked, atol=0.02)


def sample(tilt: FloatArray, rate: FloatArray) -> ImuSample:
    """A link that leans by a rotation vector (3,) rad, and turns at (3,) rad/s."""
    angle = float(np.linalg.norm(tilt))
    half = np.array([np.cos(0.5 * angle), *(np.sin(0.5 * angle) * tilt / max(angle, 1e-12))])
    return ImuSample(0.0, half, rate, np.array([0.0, 0.0, 9.81]), True, 0.0)


def corrected(measured: FloatArray, tilt: FloatArray, rate: FloatArray) -> dict[str, float]:
    """The correction, by joint, of a robot on its left foot whose encoders say (n,), its IMU (3,), (3,)."""
    gait = gait_of(op3(), stance(), dt=DT)
    compliance = np.diag(np.full(len(JOINTS), 0.05))
    feedback, seen = Feedback(op3(), stance(), gait, compliance), WalkDynamics(op3(), stance())
    for _ in range(200):
        feedback.measure(measured, sample(tilt, rate))
    look = seen.look(stance().q)
    planned = feedback.plan(look, None)
    found = feedback.correction(look, planned, np.array([1.0, 0.0]))
    return dict(zip(JOINTS, found.tolist(), strict=True))


def sense(joint: str, axis: int) -> float:
    """Which way a joint turns what is beyond it about an axis of the world."""
    return float(op3().body.joint_axis[op3().body.joint_index(joint)][axis])


def test_a_robot_that_is_where_it_was_planned_is_left_alone() -> None:
    assert max(map(abs, corrected(stand(), np.zeros(3), np.zeros(3)).values())) < 1e-9


def test_a_trunk_that_leans_forward_is_turned_back_by_hip_and_ankle_that_carry() -> None:
    """About y, forward: a hip turns the leg beyond it forward, and so the trunk back; the ankle presses the toes
    down."""
    found = corrected(stand(), np.array([0.0, 0.05, 0.0]), np.zeros(3))
    assert found["l_hip_pitch"] * sense("l_hip_pitch", 1) > 0.02
    assert found["l_ank_pitch"] * sense("l_ank_pitch", 1) > 0.005
    assert not any(value for joint, value in found.items() if joint.startswith("r_"))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_mass_that_is_not_where_it_was_planned_is_pushed_back_by_the_ankle(way: float) -> None:
    """Legs that lean forward under an upright trunk: the toes press."""
    measured = stand()
    for side in "lr":
        for joint, lean in ((f"{side}_hip_pitch", 0.03), (f"{side}_ank_pitch", -0.03)):
            measured[JOINTS.index(joint)] += way * lean * sense(joint, 1)
    found = corrected(measured, np.zeros(3), np.zeros(3))
    assert way * found["l_ank_pitch"] * sense("l_ank_pitch", 1) > 0.005
    assert abs(found["l_hip_pitch"]) < 1e-9 and not found["r_ank_pitch"]
