"""Goals of a walking robot: torques beside MuJoCo's inverse dynamics, bounds of offsets, and which way feedback
pushes."""

from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest

from followers import op3, stance
from hardware.imu import ImuSample
from retarget.robot.deflection_compensation import DeflectionCompensation
from retarget.robot.walking.gait import gait_of
from retarget.robot.walking.walking_goals import MOST_WALKING_RAD, Feedback, WalkDynamics, WalkingGoals
from retarget.types import FloatArray
from sim.physics.mount import mount_of
from sim.physics.perturbation import NOMINAL
from sim.physics.world import build_world

DT = 0.008
JOINTS = op3().joint_map.joints


def goals() -> WalkingGoals:
    standing = DeflectionCompensation(op3(), stance(), dt=DT, settle=0.02)
    return WalkingGoals(op3(), stance(), standing, gait_of(op3(), stance(), dt=DT))


def stand() -> FloatArray:
    return stance().q[op3().servo_columns]


@cache
def model() -> Any:
    return build_world(op3(), stand(), mount=mount_of(op3()), perturbation=NOMINAL).model


@pytest.mark.parametrize("seed", range(5))
def test_torques_of_limbs_are_those_of_inverse_dynamics(seed: int) -> None:
    """Arms and head carry nothing from the floor: what they need is what MuJoCo says without contact, armature and
    damping, up to the turning of links."""
    chance, q, one = np.random.default_rng(seed), stance().q.copy(), model()
    q[op3().servo_columns] += chance.uniform(-0.3, 0.3, len(JOINTS))
    seen, acceleration = WalkDynamics(op3(), stance()), np.zeros(op3().body.nv)
    limbs = [row for row, name in enumerate(JOINTS) if "sho" in name or "el" in name]
    dofs = [op3().body.dof_index(JOINTS[row]) for row in limbs]
    acceleration[dofs] = chance.uniform(-20.0, 20.0, len(dofs))
    dt = 1e-4
    after = op3().kinematics.integrate(q, 0.5 * dt * dt * acceleration)  # as far as before: from rest, and to it
    masses = 2.0 * (seen.look(after).masses - seen.look(q).masses) / (dt * dt)
    torque, _ = seen.torques(seen.look(q), masses)
    data, joints = mujoco.MjData(one), [one.joint(name) for name in JOINTS]
    data.qpos[:7], data.qpos[[int(joint.qposadr[0]) for joint in joints]] = q[:7], q[op3().servo_columns]
    columns = [int(joints[row].dofadr[0]) for row in limbs]
    data.qacc[columns] = acceleration[dofs]
    for step in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel):
        step(one, data)
    needed = np.zeros(one.nv)
    mujoco.mj_rne(one, data, 1, needed)
    np.testing.assert_allclose(torque[limbs], needed[columns], atol=0.02)


def test_at_rest_the_legs_carry_the_weight_and_the_foot_under_the_mass_alone() -> None:
    seen = WalkDynamics(op3(), stance())
    look = seen.look(stance().q)
    torque, shares = seen.torques(look, np.zeros_like(look.masses))
    assert shares.sum() == pytest.approx(1.0) and abs(shares[0] - 0.5) < 0.02
    carried = DeflectionCompensation(op3(), stance(), dt=DT, settle=0.02)._load.torques(stance().q, np.zeros(3))
    np.testing.assert_allclose(torque, carried[[op3().body.dof_index(joint) for joint in JOINTS]], atol=0.01)
    aside = np.zeros_like(look.masses)
    aside[:, 1] = -5.0  # m/s^2 to the right: the soles push to the right, the left one more
    assert seen.torques(look, aside)[1].tolist() == [1.0, 0.0]


@pytest.mark.parametrize("seed", range(5))
def test_offsets_have_bounds_for_any_posture(seed: int) -> None:
    chance, one = np.random.default_rng(seed), goals()
    state, posture, limits = one.begin(stand()), stand(), op3().limits
    for _ in range(60):
        posture = np.clip(posture + chance.normal(0.0, 0.1, len(posture)), limits.lower, limits.upper)
        ahead = posture + chance.normal(0.0, 0.1, 20)
        goal, state = one.propose(state, posture, lambda goal: goal, ahead=ahead, walks=True)
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


def corrected(measured: FloatArray, tilt: float = 0.0) -> dict[str, float]:
    """The correction, by joint, of a robot at rest on its left foot: its encoders say (n,) and its IMU that it leans
    forward by `tilt` rad."""
    compliance = np.diag(np.full(len(JOINTS), 0.05))
    feedback = Feedback(op3(), stance(), gait_of(op3(), stance(), dt=DT), compliance)
    quat = np.array([np.cos(0.5 * tilt), 0.0, np.sin(0.5 * tilt), 0.0])
    sample = ImuSample(0.0, quat, np.zeros(3), np.array([0.0, 0.0, 9.81]), True, 0.0)
    for _ in range(200):
        feedback.measure(measured, sample)
    look = WalkDynamics(op3(), stance()).look(stance().q)
    found = feedback.correction(look, feedback.plan(look, None), np.array([1.0, 0.0]))
    return dict(zip(JOINTS, found.tolist(), strict=True))


def sense(joint: str) -> float:
    """The direction in which a joint turns what is beyond it about y of the world."""
    return float(op3().body.joint_axis[op3().body.joint_index(joint)][1])


def test_a_trunk_that_leans_forward_is_turned_back_by_hip_and_ankle_that_carry() -> None:
    """About y, forward: a hip turns the leg beyond it forward, and so the trunk back; the ankle presses the toes
    down. A robot that is where it was planned is left alone."""
    found = corrected(stand(), 0.05)
    assert found["l_hip_pitch"] * sense("l_hip_pitch") > 0.02
    assert found["l_ank_pitch"] * sense("l_ank_pitch") > 0.005
    assert not any(value for joint, value in found.items() if joint.startswith("r_"))
    assert max(map(abs, corrected(stand()).values())) < 1e-9


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_mass_that_is_not_where_it_was_planned_is_pushed_back_by_the_ankle(sign: float) -> None:
    """Legs that lean forward under an upright trunk: the toes press."""
    measured = stand()
    for side in "lr":
        for joint, lean in ((f"{side}_hip_pitch", 0.03), (f"{side}_ank_pitch", -0.03)):
            measured[JOINTS.index(joint)] += sign * lean * sense(joint)
    found = corrected(measured)
    assert sign * found["l_ank_pitch"] * sense("l_ank_pitch") > 0.005
    assert abs(found["l_hip_pitch"]) < 1e-9 and not found["r_ank_pitch"]
