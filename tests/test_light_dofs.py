"""Joints that move next to nothing of a robot's mass are not asked to keep it over its soles."""

from dataclasses import replace

import numpy as np
import pytest

from followers import DT, dimensions, op3, performer, postures
from retarget import _solver
from retarget.follow import Follower
from retarget.light_dofs import light_dofs
from retarget.priorities import load_priorities
from retarget.robot_body import load_robot
from retarget.robot_reader import robot_frames


@pytest.mark.parametrize(
    ("robot", "light", "heavy"),
    [
        ("op3", ("head_pan", "head_tilt"), ("l_sho_pitch", "l_el", "l_knee", "r_hip_roll")),
        ("wolfgang", ("HeadPan", "HeadTilt"), ("LShoulderPitch", "LElbow", "LKnee", "RHipRoll")),
        ("toddlerbot", ("neck_yaw", "neck_pitch"), ("left_elbow_roll", "left_knee", "waist_roll")),
        ("poppy", ("head_y", "head_z"), ("l_knee_y", "l_shoulder_x", "abs_y")),
    ],
)
def test_heads_are_light_and_legs_and_trunks_are_not(
    robot: str, light: tuple[str, ...], heavy: tuple[str, ...]
) -> None:
    body = load_robot(robot).body
    names = {body.dof_names[dof] for dof in light_dofs(body, robot_frames(load_robot(robot)))}
    assert names >= set(light) and not names & set(heavy)


def test_a_heavy_head_is_not_light() -> None:
    body = op3().body
    mass = body.mass.copy()
    mass[body.joint_body[body.joint_index("head_tilt")]] *= 20.0
    heavy = replace(body, mass=mass)
    assert light_dofs(heavy, robot_frames(op3())) == []


@pytest.mark.parametrize("without", [[], [0], [3, 1]])
def test_a_support_is_kept_by_the_others_alone(without: list[int]) -> None:
    """The mass of a free body is pushed back along x: by those that may, the least way."""
    body = op3().body
    solver_body, q = body.solver_body(), op3().posture(op3().profile.postures.stand)
    com = solver_body.centre_of_mass(q[None])[0]
    wide = np.full(body.nv, np.inf)
    solver = _solver.Solver(
        solver_body,
        [[_solver.Task.support(1, without=without)]],
        lower=-wide,
        upper=wide,
        max_velocity=wide,
        max_acceleration=wide,
        locked=np.zeros(body.nv, dtype=np.bool_),
        n_ik=1,
    )
    solver.reset(q)
    moved = solver_body.difference(q, solver.frame(np.array([1.0, 1.0, 0.0, 0.0, com[0] - 0.01]), DT))
    column = solver_body.centre_of_mass_jacobian(q)[0]
    column[without] = 0.0
    assert np.abs(moved[without]).max(initial=0.0) < 1e-12
    assert np.abs(moved).max() > 1e-3
    along = moved @ column / np.linalg.norm(moved) / np.linalg.norm(column)
    assert along == pytest.approx(-1.0, abs=0.05)


def test_a_head_is_not_swung_for_balance() -> None:
    """OP3's, whose performer hardly turns theirs; it went from stop to stop."""
    robot = Follower(op3(), load_priorities("steady"), dimensions(performer()))
    motion = postures(performer())
    robot.start(motion[0])
    robot.arrive(motion[0], DT)
    pan = op3().body.joint_qpos[op3().body.joint_index("head_pan")]
    angles = np.array([robot.step(human, DT).q[pan] for human in motion[:1000]])
    assert np.abs(angles).max() < 0.6
