"""01_07 has a real fault: at 28.03 s most sensors jump at once. The robot moves on as if they had hurried."""

import json
from pathlib import Path

import numpy as np
import pytest

from retarget.cli import main
from retarget.model.robot import load_robot
from retarget.report.motion_summary import find_jumps
from retarget.schema.performer import load_performer
from retarget.sources.asf_amc import read_amc
from retarget.types import FloatArray

START, END, JUMP = 27.0, 31.0, 3363 / 120.0
"""Of the recording, s."""
TICKS = 501
ROUND_OFF = 2e-8
Arrays = dict[str, FloatArray]


@pytest.fixture(scope="module")
def recording(shared: Path) -> Path:
    return shared / "mocap" / "cmu_asfamc" / "01_07.amc"


@pytest.fixture(scope="module", params=["five", "six"])
def worn(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def run(recording: Path, worn: str, tmp_path_factory: pytest.TempPathFactory) -> Arrays:
    """What was sent while the robot followed."""
    folder = tmp_path_factory.mktemp(worn)
    words = ["run", "--robot", "op3", "--source", recording, "--start", START, "--end", END, "--performer", worn]
    report = folder if worn == "five" else folder / "report.json"  # with a page, or without
    with pytest.raises(SystemExit) as leaving:
        main([*map(str, words), "--report", str(report), "--save", str(folder / "run.npz")])
    assert leaving.value.code == 0
    report = json.loads((folder / "report.json").read_text())
    assert report["stop"] == {"state": "off", "reason": None}
    assert report["limit_violations"] == {"position": 0, "velocity": 0, "acceleration": 0}
    with np.load(folder / "run.npz") as saved:
        following = (saved["time"] > -1e-6) & (saved["time"] < END - START + 1e-6)
        return {key: saved[key][following] for key in saved if saved[key].shape[:1] == following.shape} | {
            key: saved[key] for key in ("joint_names", "landmark_names", "human_joint_names")
        }


def steps(track: FloatArray) -> FloatArray:
    """Distance (T - 1, k) m between neighbouring ticks of tracks (T, k, 3)."""
    return np.asarray(np.linalg.norm(np.diff(track, axis=0), axis=-1))


def after_jump(seconds: float, length: float = 0.3) -> slice:
    first = round((JUMP - START + seconds) * 125.0)
    return slice(first, first + round(length * 125.0))


def test_the_sensors_do_jump(recording: Path, worn: str) -> None:
    frames = read_amc(recording).select(tuple(load_performer(worn).sensors)).cut(START, END)
    jumps = {jump.sensor: jump.distance_m for jump in find_jumps(frames)}
    assert {jump.frame for jump in find_jumps(frames)} == {round((JUMP - START) * 120.0)}
    assert set(frames.names) - set(jumps) == {"r_ankle"}
    assert jumps["head"] > 0.2 and jumps["r_wrist"] > 0.35 and jumps["l_ankle"] > 0.5


def test_the_joints_keep_their_limits_tick_by_tick(run: Arrays) -> None:
    robot, dt = load_robot("op3"), 1.0 / 125.0
    limits, names = robot.limits, run["joint_names"].tolist()
    joints = run["joint_positions"][:, [names.index(name) for name in robot.joint_map.joints]]
    moved = np.abs(np.diff(joints, axis=0))
    assert (joints >= limits.lower - ROUND_OFF).all() and (joints <= limits.upper + ROUND_OFF).all()
    assert (moved <= limits.max_velocity * dt + ROUND_OFF).all()
    assert (np.abs(np.diff(joints, n=2, axis=0)) <= limits.max_acceleration * dt**2 + 2.0 * ROUND_OFF).all()
    assert moved[after_jump(0.0)].max() > 1e-3  # it does go after the sensors


def test_what_is_asked_jumps_and_what_is_sent_does_not(run: Arrays) -> None:
    asked, reached = steps(run["landmarks_asked"]), steps(run["landmarks_reached"])
    hands = [run["landmark_names"].tolist().index(name) for name in ("l_hand", "r_hand")]
    assert asked[after_jump(-0.02), hands].max() > 0.010
    assert reached.max() < 0.008  # 1 m/s
    # Nor does a landmark change what it moves in a tick by a tenth of the jump.
    assert np.abs(np.diff(reached[after_jump(-0.02)], axis=0)).max() < 0.001


def test_it_recovers(run: Arrays) -> None:
    error = np.linalg.norm(run["landmarks_reached"] - run["landmarks_asked"], axis=-1)
    before, after = np.median(error[after_jump(-0.5)], axis=0), np.median(error[after_jump(0.7)], axis=0)
    assert (after < before + 0.005).all()
    names = run["human_joint_names"].tolist()
    columns = [names.index(name) for name in ("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")]
    off = np.linalg.norm(run["human_joint_positions"] - run["human_truth"], axis=-1)[:, columns]
    assert off[after_jump(-0.5)].max() < 1e-3 and off[after_jump(1.0)].max() < 1e-3
    assert off[after_jump(0.0)].max() > 0.1  # a jump is not followed at once


def test_nothing_is_lost(run: Arrays) -> None:
    assert run["time"] == pytest.approx(np.arange(TICKS) / 125.0)
    for key in ("joint_positions", "landmarks_asked", "landmarks_reached", "human_joint_positions", "servo_positions"):
        assert len(run[key]) == TICKS and np.isfinite(run[key]).all(), key
    assert (run["goal_ticks"] >= 0).all()
    assert not run["gated"].any()  # the stages slowed down by themselves
