"""A saved run, looked at: every row as it was, and one clear error for what is none."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from retarget.errors import InputError
from retarget.viewer.recorded import RecordedRun, open_recorded
from saved_runs import saved_run
from support.messages import Facts, refuses


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return saved_run(tmp_path_factory.mktemp("run") / "run.npz", robot="op3")


@pytest.fixture(scope="module")
def run(path: Path) -> RecordedRun:
    return open_recorded(path)


def test_every_row_is_as_it_was(path: Path, run: RecordedRun) -> None:
    with np.load(path) as saved:
        arrays = {key: saved[key] for key in saved}
    robot = run.cast.robot
    assert robot is not None and run.cast.joints == tuple(arrays["joint_names"])
    assert not run.cast.servos_told
    states = {run.moment(row).state for row in range(len(run.times))}
    assert states == {"approaching", "following", "stopping"}
    for row in (0, len(run.times) // 2, len(run.times) - 1):
        moment = run.moment(row)
        assert moment.time == arrays["time"][row]
        np.testing.assert_array_equal(moment.sent, arrays["joint_positions"][row])
        np.testing.assert_array_equal(moment.goal[:3], arrays["root_position"][row])
        column = robot.body.joint_qpos[robot.body.joint_index("l_knee")]
        joint = run.cast.joints.index("l_knee")
        assert moment.goal[column] == moment.sent[joint]
        assert moment.robot[column] == moment.present[joint]
        assert 0.0 < moment.off < 0.2
    track = run.track(3)
    np.testing.assert_array_equal(track.sent, arrays["joint_positions"][:, 3])
    np.testing.assert_array_equal(track.present, arrays["servo_positions"][:, 3])
    assert np.isnan(track.temperature).all() and len(track.time) == len(run.times)


def test_the_centre_of_mass_is_over_the_soles_of_the_profile(run: RecordedRun) -> None:
    assert run.cast.profile is not None and run.cast.profile.profile.name == "op3"
    moment = run.moment(len(run.times) // 2)
    com, zmp = moment.com, moment.zmp
    assert np.abs(com[:2]).max() < 0.1 and 0.1 < com[2] < 0.4
    assert zmp is not None and 1e-5 < np.abs(zmp - com[:2]).max() < 0.1
    for row in (0, len(run.times) - 1):
        zmp = run.moment(row).zmp
        assert zmp is not None and np.isnan(zmp).all(), "nobody knows what was before, or comes after"


def test_a_human_alone_has_no_robot(tmp_path: Path) -> None:
    run = open_recorded(saved_run(tmp_path / "human.npz", robot="human"))
    moment = run.moment(5)
    assert run.cast.robot is None and run.cast.joints == () and run.cast.landmarks == ()
    assert run.cast.sensors and moment.sensors is not None and np.isfinite(moment.sensors).all()
    assert np.isfinite(moment.com).all() and np.isnan(moment.off)


def test_sensors_are_shown_where_they_were_kept(path: Path, run: RecordedRun, tmp_path: Path) -> None:
    with np.load(path) as saved:
        arrays = {key: saved[key] for key in saved}
    moment = run.moment(40)
    assert run.cast.sensors == tuple(arrays["sensor_names"]) and moment.sensors is not None
    np.testing.assert_array_equal(moment.sensors, arrays["sensor_positions"][40])
    older = tmp_path / "older.npz"
    np.savez(older, **{key: value for key, value in arrays.items() if not key.startswith("sensor_")})
    assert open_recorded(older).cast.sensors == () and open_recorded(older).moment(40).sensors is None


def _without(arrays: dict[str, Any], key: str) -> dict[str, Any]:
    return {name: value for name, value in arrays.items() if name != key}


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (lambda a: _without(a, "phase"), ()),
        (lambda a: a | {"time": a["time"][:0]}, ()),
        (lambda a: a | {"human_q": a["human_q"][:-1]}, "human_q"),
        (lambda a: a | {"servo_positions": a["servo_positions"][:-1]}, "servo_positions"),
        (
            lambda a: a | {"sensor_positions": a["sensor_positions"][:-1]},
            "sensor_positions",
        ),
        (lambda a: a | {"sensor_names": a["sensor_names"][1:]}, "sensor_positions"),
        (
            lambda a: a | {"joint_positions": a["joint_positions"] * np.nan},
            ("joint_positions", 1),
        ),
        (lambda a: a | {"joint_positions": a["joint_positions"][:, 1:]}, "joint_positions"),
        (lambda a: a | {"joint_positions": a["joint_positions"].astype("U9")}, "joint_positions"),
        (lambda a: a | {"servo_positions": a["servo_positions"][:, 1:]}, "servo_positions"),
        (lambda a: a | {"root_position": a["root_position"][:, 1:]}, "root_position"),
        (lambda a: a | {"root_quaternion": a["root_quaternion"][:, 1:]}, "root_quaternion"),
        (lambda a: a | {"landmarks_asked": a["landmarks_asked"][:, 1:]}, "landmarks_asked"),
        (lambda a: a | {"human_q": a["human_q"][:, 1:]}, ()),
        (lambda a: a | {"time": a["time"].astype("U9")}, ()),
        (lambda a: a | {"time": a["time"][::-1]}, ()),
        (lambda a: a | {"body": np.array("/nowhere/body.xml")}, ()),
        (lambda a: a | {"joint_names": a["joint_names"][::-1].astype("U20") + np.array(["x"])}, ()),
        (lambda a: a | {"human_mjcf": np.array("<mujoco")}, ()),
        (lambda a: a | {"phase": np.array([None] * len(a["time"]), dtype=object)}, "allow_pickle"),
    ],
)
def test_what_is_no_run_is_refused(path: Path, tmp_path: Path, change: Any, found: Facts) -> None:
    with np.load(path) as saved:
        arrays = {key: saved[key] for key in saved}
    changed = tmp_path / "changed.npz"
    np.savez(changed, **change(arrays))
    with refuses(InputError, found) as refused:
        open_recorded(changed)
    assert str(changed) in str(refused.value)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"\x93NUMPY\x01\x00", b"time,joint\n0,1\n"])
def test_what_is_no_file_of_ours_is_refused(tmp_path: Path, content: bytes) -> None:
    other = tmp_path / "other.npz"
    other.write_bytes(content)
    with refuses(InputError, "NPZ"):
        open_recorded(other)
    with refuses(InputError):
        open_recorded(tmp_path / "none.npz")


def test_half_a_file_is_refused(path: Path, tmp_path: Path) -> None:
    half = tmp_path / "half.npz"
    half.write_bytes(path.read_bytes()[:20000])
    with refuses(InputError, "NPZ"):
        open_recorded(half)
