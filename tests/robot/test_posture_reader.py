"""Where a robot's parts are, and their names in priorities."""

import numpy as np

from followers import op3
from retarget import rotations
from retarget.ik.support_polygon import plant
from retarget.robot.landmarks import RobotReader, robot_frames, robot_postures, standing_dofs


def test_the_stance_is_upright_and_looks_ahead() -> None:
    stance = plant(op3(), op3().profile.postures.stand)
    reached = RobotReader(op3(), stance).read(stance.q)
    assert np.allclose(reached.trunk, rotations.IDENTITY) and np.allclose(reached.gaze, (1.0, 0.0, 0.0))
    frames = [entry.frame for entry in op3().profile.landmarks.values()]
    assert np.allclose(reached.points, [stance.points[name] for name in frames])
    assert np.allclose(reached.points, reached.landmarks)
    assert np.allclose(reached.centre_of_mass, op3().body.solver_body().centre_of_mass(stance.q[None])[0])


def test_turning_head_and_root_turns_gaze_and_trunk() -> None:
    stance = plant(op3(), op3().profile.postures.stand)
    q = stance.q.copy()
    q[op3().body.joint_qpos[op3().body.joint_index("head_pan")]] = 0.5
    turn = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), 0.3)
    q[3:7] = rotations.multiply(turn, q[3:7])
    reached = RobotReader(op3(), stance).read(q)
    assert np.allclose(reached.trunk, turn) and np.allclose(reached.gaze, (np.cos(0.8), np.sin(0.8), 0.0))


def test_landmarks_frames_and_links_have_names() -> None:
    frames = robot_frames(op3())
    assert {"l_hand", "neck", "body_link"} <= set(frames)
    assert frames["l_hand"].body == op3().body.body_index("l_el_link")


def test_postures_stand_where_the_robot_does() -> None:
    stance = plant(op3(), op3().profile.postures.stand)
    postures = robot_postures(op3(), stance)
    assert set(postures) == {"neutral", "stand", "rest", "attractor"}
    assert np.allclose(postures["stand"], stance.q)
    assert np.allclose(postures["rest"][:7], stance.q[:7])


def test_root_and_legs_carry_the_robot() -> None:
    names = np.array(op3().body.dof_names)[standing_dofs(op3())]
    assert len(names) == 18
    assert all(name.startswith("root_") or any(part in name for part in ("hip", "knee", "ank")) for name in names)
