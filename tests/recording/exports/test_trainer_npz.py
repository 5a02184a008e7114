"""NPZ for trainers: MuJoCo alone finds the same links, and velocities are those of the motion."""

import io

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from recordings import RATE, moved, op3
from retarget.model.robot import load_robot
from retarget.recording.exports.trainers import tracking_arrays, write_mjlab
from retarget.recording.motion import Motion


@pytest.fixture(scope="module")
def motion() -> Motion:
    return moved(op3(), rows=60)


def test_keys_shapes_and_types(motion: Motion) -> None:
    stream = io.BytesIO()
    write_mjlab(motion, stream)
    with np.load(io.BytesIO(stream.getvalue()), allow_pickle=False) as file:
        arrays = dict(file)
    assert arrays["fps"].tolist() == [50] and arrays["fps"].dtype == np.int64
    assert arrays["joint_names"].tolist() == list(motion.joint_names)
    assert arrays["joint_pos"].shape == arrays["joint_vel"].shape == (60, 20)
    assert arrays["body_pos_w"].shape == arrays["body_lin_vel_w"].shape == arrays["body_ang_vel_w"].shape == (60, 21, 3)
    assert str(arrays["quaternion_order"]) == "wxyz"
    assert arrays["body_quat_w"].shape == (60, 21, 4) and arrays["body_names"][0] == "body_link"
    assert {array.dtype for key, array in arrays.items() if array.ndim > 1} == {np.dtype(np.float32)}


def test_mujoco_finds_the_same_links(motion: Motion) -> None:
    arrays = tracking_arrays(motion)
    model = mujoco.MjModel.from_xml_path(str(load_robot("op3").profile.body_path))
    data = mujoco.MjData(model)
    for row in (0, 31):
        data.qpos[:3], data.qpos[3:7] = arrays["body_pos_w"][row, 0], arrays["body_quat_w"][row, 0]
        for name, angle in zip(arrays["joint_names"], arrays["joint_pos"][row], strict=True):
            data.joint(str(name)).qpos[:] = angle
        mujoco.mj_kinematics(model, data)
        for index, name in enumerate(arrays["body_names"]):
            link = data.body(str(name))
            np.testing.assert_allclose(arrays["body_pos_w"][row, index], link.xpos, atol=1e-6)
            same = abs(float(arrays["body_quat_w"][row, index] @ link.xquat))
            assert same == pytest.approx(1.0, abs=1e-6)


def test_velocities_are_derivatives(motion: Motion) -> None:
    arrays = tracking_arrays(motion)
    step = np.diff(motion.joints, axis=0) * RATE
    np.testing.assert_allclose(arrays["joint_vel"][1:-1], (step[1:] + step[:-1]) / 2.0, rtol=1e-4, atol=1e-4)
    row, link = 20, 7
    turns = Rotation.from_quat(arrays["body_quat_w"][[row - 1, row + 1], link].astype(float), scalar_first=True)
    world = (turns[1] * turns[0].inv()).as_rotvec() * RATE / 2.0
    np.testing.assert_allclose(arrays["body_ang_vel_w"][row, link], world, atol=1e-3)


def test_a_turning_root_has_its_speed_at_every_row_also_at_the_ends() -> None:
    motion = moved(op3(), rows=30)
    turn = Rotation.from_rotvec(np.outer(motion.time, [0.3, -0.4, 1.2]))
    motion.q[:, 3:7] = turn.as_quat(scalar_first=True)
    np.testing.assert_allclose(tracking_arrays(motion)["body_ang_vel_w"][:, 0], [[0.3, -0.4, 1.2]] * 30, atol=1e-5)
