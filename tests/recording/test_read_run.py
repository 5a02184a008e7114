"""A saved run as a motion; and everything that is none, in one clear message."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from messages import Facts, mentions, refuses, shows
from recordings import SLIDER, Recorded, moved, record, saved, slider, with_servos
from retarget.cli import main
from retarget.errors import InputError
from retarget.recording.exports.formats import FORMATS, export_motion, export_place
from retarget.recording.motion import Motion
from retarget.recording.npz import write_npz
from retarget.recording.read_run import read_run
from retarget.run.options import RunOptions
from retarget.run.record import Phase


@pytest.fixture
def motion() -> Motion:
    return with_servos(moved(slider()))


@pytest.fixture
def body(tmp_path: Path) -> Path:
    path = tmp_path / "slider.xml"
    path.write_text(SLIDER)
    return path


def test_everything_comes_back(motion: Motion, body: Path, tmp_path: Path) -> None:
    found = read_run(saved(motion, tmp_path / "run.npz", body))
    assert found.robot == "slider" and found.joint_names == motion.joint_names == ("lift", "swing", "roll")
    assert found.joint_units == ("m", "rad", "rad")
    np.testing.assert_allclose(found.q, motion.q, atol=1e-12)
    for ours, theirs in ((found.present, motion.present), (found.goal_ticks, motion.goal_ticks)):
        np.testing.assert_array_equal(ours, theirs)
    assert found.landmark_names == ("hand", "lost") and "landmarks_asked" in found


def test_a_body_that_moved_away(motion: Motion, body: Path, tmp_path: Path) -> None:
    run = saved(motion, tmp_path / "run.npz", tmp_path / "gone" / "elsewhere.xml")
    with refuses(InputError, "--body"):
        read_run(run)
    with refuses(InputError):
        read_run(saved(motion, tmp_path / "long.npz", Path("x" * 5000)))
    assert read_run(run, body=body).joint_names == motion.joint_names
    body.rename(tmp_path / "elsewhere.xml")  # beside the run is where a colleague would have put it
    assert read_run(run).joint_names == motion.joint_names


def test_another_robots_body(motion: Motion, tmp_path: Path) -> None:
    other = tmp_path / "other.xml"
    other.write_text(SLIDER.replace('"swing"', '"swung"'))
    with refuses(InputError, "swing", "--body"):
        read_run(saved(motion, tmp_path / "run.npz", other))


BAD: list[tuple[dict[str, Any], Facts]] = [
    ({"time": np.arange(39) / 50.0}, "(39)"),
    ({"joint_positions": np.full((40, 3), np.nan)}, ("joint_positions", "nan", 1)),
    ({"root_position": np.full((40, 3), np.inf)}, "root_position"),
    ({"landmarks_reached": np.zeros((40, 1, 3))}, "landmarks_reached"),
    ({"root_quaternion": np.zeros((40, 4))}, "[0. 0. 0. 0.]"),
    ({"joint_names": np.arange(3)}, "joint_names"),
    ({"servo_positions": np.zeros((40, 2))}, "servo_positions"),
    ({"goal_ticks": np.zeros((40, 3))}, "goal_ticks"),
    ({"landmarks_asked": np.zeros((40, 1, 3))}, "landmarks_asked"),
    ({"phase": np.full(40, "dance")}, ("phase", "dance")),
    ({"landmark_names": np.array([0x110000], dtype=np.uint32).view("<U1")}, "landmark_names"),
    ({"time": np.zeros(40)}, ()),
    ({"time": np.zeros(0)}, ()),
    ({"time": np.arange(40)[::-1].astype(float)}, ()),
    ({"time": None, "root_position": None}, "root_position"),  # both are listed
]


@pytest.mark.parametrize(("other", "facts"), BAD)
def test_wrong_content_is_named_by_its_key(
    other: dict[str, Any], facts: Facts, motion: Motion, body: Path, tmp_path: Path
) -> None:
    """Time goes on, and all that is missing is listed at once."""
    with refuses(InputError, facts):
        read_run(saved(motion, tmp_path / "run.npz", body, **other))


def test_what_is_no_run(tmp_path: Path) -> None:
    (tmp_path / "text.npz").write_text("time, x\n")
    (tmp_path / "empty.npz").touch()
    np.savez(tmp_path / "other.npz", poses=np.zeros(3))
    with zipfile.ZipFile(tmp_path / "zip.npz", "w") as archive:
        archive.writestr("time.npy", b"no array")
    (tmp_path / "folder.npz").mkdir()
    for name in ("text", "empty", "other", "zip", "folder", "missing"):
        with refuses(InputError, f"{name}.npz"):
            read_run(tmp_path / f"{name}.npz")
    with refuses(InputError):
        read_run(tmp_path / "run.csv")


SINGLE = 3e-7
"""Goals and the root are kept in single precision."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("export") / "run.mcap")


@pytest.fixture(scope="module")
def recorded(run: Recorded) -> Motion:
    return read_run(run.path)


@pytest.fixture(scope="module")
def then(run: Recorded) -> Motion:
    """The same run as it was saved."""
    write_npz(run.result, run.path.with_suffix(".npz"))
    return read_run(run.path.with_suffix(".npz"))


def test_rows_are_those_of_the_run_that_was_saved(recorded: Motion, then: Motion) -> None:
    assert recorded.joint_names == then.joint_names and recorded.robot == then.robot == "op3"
    assert recorded.notes == () and recorded.row == "tick" and recorded.rate_hz == 125.0
    np.testing.assert_allclose(recorded.time, then.time, atol=1e-12)
    np.testing.assert_array_equal(recorded.phase, then.phase)
    np.testing.assert_allclose(recorded.q, then.q, atol=SINGLE)
    for ours, theirs in ((recorded.goal_ticks, then.goal_ticks), (recorded.present, then.present)):
        np.testing.assert_array_equal(ours, theirs)


def test_landmarks_are_those_that_were_kept_and_a_straight_line_between(recorded: Motion, then: Motion) -> None:
    order = [recorded.landmark_names.index(name) for name in then.landmark_names]
    assert sorted(recorded.landmark_names) == sorted(then.landmark_names)
    followed = np.flatnonzero(recorded.phase == Phase.FOLLOW)
    ours, theirs = recorded.landmarks_asked[followed][:, order], then.landmarks_asked[followed]
    kept = (followed + 1) % 5 == 0  # of cycles, the first of which arms
    np.testing.assert_allclose(ours[kept], theirs[kept], atol=1e-5)
    between = slice(int(np.argmax(kept)), len(kept) - int(np.argmax(kept[::-1])))
    bend = np.abs(np.diff(ours[between], n=2, axis=0)).max(axis=(1, 2))
    assert (bend[~kept[between][1:-1]] < 1e-9).all() and np.abs(ours - theirs).max() < 0.01


@pytest.mark.parametrize("form", FORMATS)
def test_every_format_takes_it(form: str, recorded: Motion, tmp_path: Path) -> None:
    followed = recorded[recorded.phase == Phase.FOLLOW]
    place = export_place(FORMATS[form], tmp_path / "run.mcap", None)
    export_motion(followed, FORMATS[form], place)
    assert place.exists()


def test_the_human_is_as_often_as_it_was_kept(run: Recorded) -> None:
    human, then = read_run(run.path, of_human=True), run.result.record
    assert human.robot == "human" and human.row == "posture that was kept" and human.rate_hz == 12.5
    shows(human.notes[0], "12.5")
    rows = np.searchsorted(run.result.record.time, human.time - 1e-9)
    np.testing.assert_allclose(run.result.record.time[rows], human.time, atol=1e-9)
    np.testing.assert_allclose(human.q, then.human_q[rows], atol=3e-6)


def test_a_human_alone_has_every_tick(tmp_path: Path) -> None:
    alone = record(tmp_path / "run.mcap", options=RunOptions(robot="human", bus="none"), seconds=0.2)
    write_npz(alone.result, tmp_path / "run.npz")
    for of_human in (False, True):
        ours, then = read_run(alone.path, of_human=of_human), read_run(tmp_path / "run.npz", of_human=of_human)
        assert ours.robot == "human" and len(ours) == len(then) and ours.notes == ()
        np.testing.assert_allclose(ours.time, then.time, atol=1e-12)
        np.testing.assert_allclose(ours.q, then.q, atol=3e-6)
    sensors = read_run(alone.path).landmarks_asked
    asked = [alone.result.clip.sample(tick).position for tick in range(alone.result.clip.ticks)]
    np.testing.assert_array_equal(sensors, asked)


def test_the_body_of_then_is_used_and_another_can_be_given(run: Recorded, recorded: Motion, tmp_path: Path) -> None:
    assert run.result.robot is not None
    body = tmp_path / "moved.xml"
    body.write_bytes(run.result.robot.profile.body_path.read_bytes())
    given = read_run(run.path, body=body)
    assert given.body.source == str(body)
    np.testing.assert_array_equal(given.q, recorded.q)
    with refuses(InputError):
        read_run(run.path, body=tmp_path / "nothing.xml")


def test_half_a_recording_is_exported_with_a_word(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("retarget.recording.mcap_writer.FLUSH_S", 0.01)
    whole = record(tmp_path / "run.mcap")
    content = whole.path.read_bytes()
    whole.path.write_bytes(content[: len(content) * 3 // 4])
    with pytest.raises(SystemExit) as left:
        main(["export", str(whole.path), "--to", "csv", "--phase", "all"])
    assert left.value.code == 0
    mentions(capsys.readouterr().err, whole.path, "it ends early", "what is whole of it is used")  # cut anywhere
    rows = (tmp_path / "run.csv").read_text().count("\n") - 1
    assert 0 < rows < len(whole.result.record)
