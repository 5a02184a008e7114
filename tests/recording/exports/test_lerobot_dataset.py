"""LeRobot v3.0: the folder, its schema, and numbers that agree with each other and with the motion."""

import csv
import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from messages import refuses
from recordings import angle_between, moved, slider, with_servos
from retarget.errors import InputError, UsageError
from retarget.model.body import load_body_text
from retarget.recording.exports.lerobot_dataset import lerobot_files
from retarget.recording.exports.tables import arrow, columns_of, write_csv, write_parquet
from retarget.recording.motion import Motion, resampled
from retarget.schema.files import write_folder

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
    write_folder(tmp_path, lerobot_files(motion, task="Wave <both> hands."), option="--out")
    return tmp_path


def read(path: Path) -> Any:
    return arrow().parquet.read_table(path)


def test_the_schema_is_what_info_says(dataset: Path, motion: Motion) -> None:
    assert {str(path.relative_to(dataset)) for path in dataset.rglob("*") if path.is_file()} == FILES
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


def test_several_motions_are_the_episodes_of_one_set(tmp_path: Path) -> None:
    motions = [with_servos(moved(slider(), rows=rows)) for rows in (11, 7, 23)]
    motions[1].landmarks_asked[:, 1] = 1.0  # known there alone
    write_folder(tmp_path, lerobot_files(*motions), option="--out")
    info = json.loads((tmp_path / "meta/info.json").read_text())
    assert (info["total_episodes"], info["total_frames"], info["splits"]) == (3, 41, {"train": "0:3"})
    frames = read(tmp_path / "data/chunk-000/file-000.parquet").to_pydict()
    assert frames["index"] == [*range(41)] and frames["frame_index"] == [*range(11), *range(7), *range(23)]
    assert frames["episode_index"] == [0] * 11 + [1] * 7 + [2] * 23 and set(frames["task_index"]) == {0}
    np.testing.assert_allclose(frames["timestamp"][11:18], np.arange(7) / 50.0, atol=1e-6)
    np.testing.assert_allclose(frames["action"], np.vstack([one.joints[:, :2] for one in motions]), atol=1e-6)
    assert info["features"]["observation.landmarks"]["names"] == ["hand.x", "hand.y", "hand.z"]
    episodes = read(tmp_path / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [(row["dataset_from_index"], row["dataset_to_index"]) for row in episodes] == [(0, 11), (11, 18), (18, 41)]
    last = motions[2].joints[:, :2].astype(np.float32)
    np.testing.assert_allclose(episodes[2]["stats/action/mean"], last.mean(axis=0), atol=1e-6)
    assert json.loads((tmp_path / "meta/stats.json").read_text())["action"]["count"] == [41]


def test_episodes_of_other_rates_robots_or_joints_are_refused(motion: Motion) -> None:
    with refuses(InputError, "25", "--fps 50"):
        lerobot_files(motion, with_servos(moved(slider(), rate_hz=25.0)))
    with refuses(InputError, "another"):
        lerobot_files(motion, replace(motion, robot="another"))
    with refuses(InputError, "action"):
        lerobot_files(motion, moved(slider()))


def test_without_servos_all_joints_are_seen_where_they_were_sent(tmp_path: Path) -> None:
    write_folder(tmp_path, lerobot_files(moved(slider())), option="--out")
    frames = read(tmp_path / "data/chunk-000/file-000.parquet")
    assert frames["action"].to_pylist() == frames["observation.state"].to_pylist()
    assert len(frames["action"][0]) == 3 and "observation.landmarks" not in frames.column_names
    assert "no servo answered" in (tmp_path / "README.md").read_text()


def test_a_rate_that_is_no_whole_number_is_refused_with_the_next_step() -> None:
    with refuses(UsageError, "--fps", 31):
        lerobot_files(moved(slider(), rate_hz=31.25))


def test_a_servo_that_was_silent_is_named(motion: Motion) -> None:
    servos = motion.present.copy()
    servos[7, 1] = np.nan
    with refuses(InputError, "swing.pos", 8):
        lerobot_files(replace(motion, present=servos))


# CSV and Parquet: names with units, every number, and nothing invented.


def test_the_header_says_what_and_in_which_unit(motion: Motion) -> None:
    names = [column.name for column in columns_of(motion)]
    assert names[:8] == ["time_s", "root_x_m", "root_y_m", "root_z_m", "root_qw", "root_qx", "root_qy", "root_qz"]
    assert names[8:11] == ["lift_m", "swing_rad", "roll_rad"]
    assert names[11:15] == ["servo_lift_m", "servo_swing_rad", "ticks_lift", "ticks_swing"]
    assert names[15:] == [f"asked_{name}_{axis}_m" for name in ("hand", "lost") for axis in "xyz"]


def test_a_csv_is_read_by_numpy_alone(motion: Motion) -> None:
    stream = io.BytesIO()
    write_csv(motion, stream)
    table = np.genfromtxt(io.StringIO(stream.getvalue().decode()), delimiter=",", names=True)
    assert len(table) == len(motion)
    np.testing.assert_allclose(table["swing_rad"], motion.joints[:, 1], rtol=1e-9)
    np.testing.assert_allclose(table["root_qy"], motion.root_quaternion[:, 2], rtol=1e-9)
    assert np.isnan(table["asked_lost_x_m"][0]) and table["asked_lost_x_m"][1] == 1.0
    assert (table["ticks_lift"] == motion.goal_ticks[:, 0]).all()


def test_names_with_commas_and_quotes_survive() -> None:
    text = '<mujoco><worldbody><body name="b"><freejoint/><geom size="0.1"/><body name="c">'
    text += '<joint name="a, &quot;b&quot;"/><geom size="0.1"/></body></body></worldbody></mujoco>'
    stream = io.BytesIO()
    write_csv(moved(load_body_text(text, source="odd")), stream)
    assert next(csv.reader(io.StringIO(stream.getvalue().decode())))[8] == 'a, "b"_rad'


def test_parquet_has_every_digit_and_the_units(motion: Motion) -> None:
    stream = io.BytesIO()
    write_parquet(motion, stream)
    table = arrow().parquet.read_table(io.BytesIO(stream.getvalue()))
    assert table.column_names == [column.name for column in columns_of(motion)]
    assert (table["swing_rad"].to_numpy() == motion.joints[:, 1]).all()
    assert table.schema.field("lift_m").metadata == {b"unit": b"m"}
    assert table["asked_lost_x_m"].null_count == 1
    about = json.loads(table.schema.metadata[b"retarget"])
    assert about["root_link"] == "base" and about["rows"] == len(motion) and "z up" in about["world"]


# Resampling: rows between rows, never beyond them, and a rate of one's own changes nothing.


@given(st.floats(0.5, 400.0), st.integers(1, 60))
def test_rows_are_even_and_within_the_motion(fps: float, rows: int) -> None:
    motion = moved(slider(), rows=rows)
    if rows > 1 and (rows - 1) * fps / 50.0 < 1.0:
        with refuses(UsageError):
            resampled(motion, fps)
        return
    new = resampled(motion, fps)
    assert new.time[0] == motion.time[0] and new.time[-1] <= motion.time[-1] + 1e-9
    assert motion.time[-1] - new.time[-1] < 1.0 / fps + 1e-9
    np.testing.assert_allclose(np.diff(new.time), 1.0 / fps, rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(new.root_quaternion, axis=1), 1.0, atol=1e-12)
    assert (new.joints.max(axis=0) <= motion.joints.max(axis=0) + 1e-12).all()


def test_at_shared_instants_nothing_changes() -> None:
    motion = with_servos(moved(slider(), rows=41))
    for fps, ours, theirs in ((25.0, slice(None), slice(None, None, 2)), (100.0, slice(None, None, 2), slice(None))):
        new = resampled(motion, fps)
        np.testing.assert_allclose(new.joints[ours], motion.joints[theirs], atol=1e-9)
        assert angle_between(new.root_quaternion[ours], motion.root_quaternion[theirs]).max() < 1e-6
        np.testing.assert_allclose(new.present[ours], motion.present[theirs], atol=1e-9)
        assert "goal_ticks" not in new


def test_between_two_rows_lies_the_middle_also_where_the_quaternion_changes_its_sign() -> None:
    motion = moved(slider(), rows=3)
    motion.q[1, 3:7] *= -1.0
    new = resampled(motion, 100.0)
    np.testing.assert_allclose(new.joints[1], motion.joints[:2].mean(axis=0), atol=1e-12)
    halves = angle_between(new.root_quaternion[[1, 1]], motion.root_quaternion[:2])
    assert halves[0] == pytest.approx(halves[1], abs=1e-6) and halves[0] < 2.0


def test_rows_that_come_when_they_like_become_even() -> None:
    motion = moved(slider())
    motion.time[:] = np.sort(np.random.default_rng(3).uniform(0.0, 2.0, len(motion)))
    with refuses(InputError):
        _ = motion.rate_hz
    assert resampled(motion, 30.0).rate_hz == pytest.approx(30.0)


@pytest.mark.parametrize("fps", [0.0, -5.0, float("nan"), float("inf"), 1001.0])
def test_impossible_rates(fps: float) -> None:
    with refuses(UsageError, "--fps"):
        resampled(moved(slider()), fps)
