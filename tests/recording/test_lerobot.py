"""LeRobot v3.0: the folder, its schema, and numbers that agree with each other and with the motion."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from exported import moved, slider, with_servos
from messages import refuses
from retarget.errors import InputError, UsageError
from retarget.recording.lerobot import write_lerobot
from retarget.recording.motion import Motion
from retarget.recording.tables import arrow

FILES = {
    *("README.md", "data/chunk-000/file-000.parquet", "meta/episodes/chunk-000/file-000.parquet"),
    *("meta/info.json", "meta/stats.json", "meta/tasks.parquet"),
}
ARROW = arrow()
DTYPES = {"float32": ARROW.float32(), "int64": ARROW.int64()}


@pytest.fixture
def motion() -> Motion:
    return with_servos(moved(slider()))


@pytest.fixture
def dataset(motion: Motion, tmp_path: Path) -> Path:
    write_lerobot(motion, tmp_path, task="Wave <both> hands.")
    return tmp_path


def read(path: Path) -> Any:
    return arrow().parquet.read_table(path)


def test_every_file_is_there_and_no_other(dataset: Path) -> None:
    assert {str(path.relative_to(dataset)) for path in dataset.rglob("*") if path.is_file()} == FILES


def test_the_schema_is_what_info_says(dataset: Path, motion: Motion) -> None:
    info = json.loads((dataset / "meta/info.json").read_text())
    assert info["codebase_version"] == "v3.0" and info["fps"] == 50 and type(info["fps"]) is int
    assert info["total_frames"] == len(motion) and info["total_episodes"] == info["total_tasks"] == 1
    assert info["splits"] == {"train": "0:1"} and info["video_path"] is None
    frames = read(dataset / info["data_path"].format(chunk_index=0, file_index=0))
    assert set(frames.column_names) == set(info["features"])
    for key, feature in info["features"].items():
        kind, size = frames.schema.field(key).type, feature["shape"][0]
        if feature["names"] is None:
            assert size == 1 and kind == DTYPES[feature["dtype"]]
        else:
            assert kind == ARROW.list_(DTYPES[feature["dtype"]], size) and len(feature["names"]) == size
    assert info["features"]["action"]["names"] == ["lift.pos", "swing.pos"]  # the last joint has no servo
    assert info["features"]["observation.landmarks"]["names"] == ["hand.x", "hand.y", "hand.z"]


def test_what_was_seen_comes_before_what_was_done(dataset: Path, motion: Motion) -> None:
    frames = read(dataset / "data/chunk-000/file-000.parquet")
    action, state = (np.array(frames[key].to_pylist()) for key in ("action", "observation.state"))
    np.testing.assert_allclose(action, motion.joints[:, :2], atol=1e-6)
    np.testing.assert_allclose(state, motion.joints[:, :2] - 0.01, atol=1e-6)
    np.testing.assert_allclose(np.array(frames["observation.root"].to_pylist()), motion.q[:, :7], atol=1e-6)
    assert frames["frame_index"].to_pylist() == frames["index"].to_pylist() == list(range(len(motion)))
    np.testing.assert_allclose(frames["timestamp"].to_numpy(), np.arange(len(motion)) / 50.0, atol=1e-6)
    assert set(frames["episode_index"].to_pylist()) == set(frames["task_index"].to_pylist()) == {0}


def test_statistics_are_those_of_the_frames(dataset: Path, motion: Motion) -> None:
    stats = json.loads((dataset / "meta/stats.json").read_text())
    info = json.loads((dataset / "meta/info.json").read_text())
    assert set(stats) == set(info["features"])
    action = motion.joints[:, :2].astype(np.float32)
    assert stats["action"]["count"] == [len(motion)]
    np.testing.assert_allclose(stats["action"]["mean"], action.mean(axis=0), atol=1e-6)
    np.testing.assert_allclose(stats["action"]["std"], action.std(axis=0), atol=1e-6)
    np.testing.assert_allclose(stats["action"]["q99"], np.percentile(action, 99, axis=0), atol=1e-6)
    assert stats["timestamp"]["min"] == [0.0] and len(stats["observation.root"]["max"]) == 7
    episode = read(dataset / "meta/episodes/chunk-000/file-000.parquet").to_pylist()[0]
    assert episode["stats/action/mean"] == stats["action"]["mean"]


def test_the_episode_points_at_its_frames(dataset: Path, motion: Motion) -> None:
    episode = read(dataset / "meta/episodes/chunk-000/file-000.parquet").to_pylist()[0]
    assert episode["tasks"] == ["Wave <both> hands."] and episode["length"] == len(motion)
    assert (episode["dataset_from_index"], episode["dataset_to_index"]) == (0, len(motion))
    places = [key for key in episode if key.endswith(("chunk_index", "file_index"))]
    assert len(places) == 4 and all(episode[key] == 0 for key in places)


def test_without_servos_all_joints_are_seen_where_they_were_sent(tmp_path: Path) -> None:
    write_lerobot(moved(slider()), tmp_path)
    frames = read(tmp_path / "data/chunk-000/file-000.parquet")
    assert frames["action"].to_pylist() == frames["observation.state"].to_pylist()
    assert len(frames["action"][0]) == 3 and "observation.landmarks" not in frames.column_names
    assert "no servo answered" in (tmp_path / "README.md").read_text()


def test_a_rate_that_is_no_whole_number_is_refused_with_the_next_step(tmp_path: Path) -> None:
    with refuses(UsageError, "--fps", 31):
        write_lerobot(moved(slider(), rate_hz=31.25), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_servo_that_was_silent_is_named(motion: Motion, tmp_path: Path) -> None:
    assert motion.servos is not None
    servos = motion.servos.copy()
    servos[7, 1] = np.nan
    with refuses(InputError, "swing.pos", 8):
        write_lerobot(replace(motion, servos=servos), tmp_path)
    assert list(tmp_path.iterdir()) == []
