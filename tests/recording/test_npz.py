"""`--save`: keys, shapes, and the same landmarks where MuJoCo alone reads the file."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from hardware.clock import VirtualClock
from messages import refuses
from retarget.errors import UsageError
from retarget.recording.npz import human_body_path, save_path, write_npz
from retarget.run.loop import Operator, run_human
from retarget.run.run_result import RunResult
from retarget.run.table import STAGES
from rig import StubReconstructor, person, result, scripted_run, short_clip

CONTRACT = {
    *("time", "joint_names", "joint_positions", "root_position", "root_quaternion", "goal_ticks", "landmark_names"),
    *("landmarks_asked", "landmarks_reached", "body", "gated", "human_joint_names", "human_joint_positions"),
    "human_truth",
}


@pytest.fixture(scope="module")
def run() -> RunResult:
    return scripted_run()


def test_a_run_of_a_robot(run: RunResult, tmp_path: Path) -> None:
    write_npz(run, save_path(tmp_path / "run.npz"))
    with np.load(tmp_path / "run.npz", allow_pickle=False) as data:
        saved = dict(data)
    assert set(saved) >= CONTRACT
    ticks, joints = saved["joint_positions"].shape
    assert (ticks, joints) == (len(run.record), 20) == saved["goal_ticks"].shape
    assert saved["time"].shape == saved["gated"].shape == saved["phase"].shape == (ticks,)
    assert saved["root_position"].shape == (ticks, 3) and saved["root_quaternion"].shape == (ticks, 4)
    assert saved["landmarks_asked"].shape == saved["landmarks_reached"].shape == (ticks, 10, 3)
    assert saved["human_truth"].shape == saved["human_joint_positions"].shape
    assert all(np.array_equal(saved[name], getattr(run.record, name), equal_nan=True) for name in STAGES)
    assert saved["gated"].dtype == np.bool_ and saved["goal_ticks"].dtype == np.int64
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.npz"]
    assert run.robot is not None and run.record.robot is not None
    columns = [saved["joint_names"].tolist().index(joint) for joint in run.robot.joint_map.joints]
    np.testing.assert_array_equal(saved["servo_positions"][:, columns], run.record.robot.present)
    np.testing.assert_array_equal(saved["goal_ticks"][:, columns], run.record.robot.goal_ticks)


def test_every_tick_says_what_it_was_for_and_nothing_is_unknown(run: RunResult, tmp_path: Path) -> None:
    write_npz(run, tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz") as data:
        phase, time, asked, truth = (data[key] for key in ("phase", "time", "landmarks_asked", "human_truth"))
    follow = phase == "follow"
    assert set(phase) == {"approach", "follow", "brake"} and np.count_nonzero(follow) == 51
    assert time[follow][0] == 0.0 and (time[phase == "approach"] < 0.0).all()
    for tracks in (asked, truth):
        known = tracks[:, np.isfinite(tracks[follow]).all(axis=(0, 2))]
        assert known.size and (known[phase == "approach"] == known[follow][0]).all()
        assert (known[phase == "brake"] == known[follow][-1]).all()


def test_mujoco_alone_finds_the_same_landmarks(run: RunResult, tmp_path: Path) -> None:
    write_npz(run, tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz") as data:
        saved = dict(data)
    model = mujoco.MjModel.from_xml_path(str(saved["body"]))
    state = mujoco.MjData(model)
    tick = 40
    state.qpos[:3], state.qpos[3:7] = saved["root_position"][tick], saved["root_quaternion"][tick]
    for name, angle in zip(saved["joint_names"], saved["joint_positions"][tick], strict=True):
        state.joint(str(name)).qpos[:] = angle
    mujoco.mj_kinematics(model, state)
    hand = saved["landmark_names"].tolist().index("l_hand")
    link = state.body("l_el_link")
    reached = link.xpos + link.xmat.reshape(3, 3) @ [-0.019, 0.15, 0.0]
    np.testing.assert_allclose(reached, saved["landmarks_reached"][tick, hand], atol=1e-9)


def test_a_run_of_the_human_brings_its_body(tmp_path: Path) -> None:
    human, clip = person(), short_clip(rate_hz=None)
    ending = run_human(clip, StubReconstructor(human), Operator(), VirtualClock())
    path = tmp_path / "run.npz"
    write_npz(result(ending, clip, human, None), path)
    with np.load(path) as data:
        saved = dict(data)
    assert set(saved) >= CONTRACT
    assert str(saved["body"]) == human_body_path(path).name, "the folder may be moved"
    model = mujoco.MjModel.from_xml_path(str(human_body_path(path)))
    names = [model.joint(index).name for index in range(model.njnt) if model.jnt_type[index] == 3]
    assert names == saved["joint_names"].tolist()
    assert (saved["goal_ticks"] == -1).all() and not saved["gated"].any()
    assert saved["landmark_names"].tolist() == list(clip.frames.names)


@pytest.mark.parametrize("name", ["run.npy", "run", "nowhere/run.npz"])
def test_places_that_cannot_hold_a_run(name: str, tmp_path: Path) -> None:
    with refuses(UsageError, "--save"):
        save_path(tmp_path / name)
    assert list(tmp_path.iterdir()) == []
