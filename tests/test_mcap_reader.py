"""A recording as a motion: the rows are those that a replay of it saves; what is kept less often is said."""

from pathlib import Path

import numpy as np
import pytest

from recordings import Recorded, record
from retarget.cli import main
from retarget.errors import InputError
from retarget.exporting import FORMATS, export_motion, export_place, read_run
from retarget.exporting.motion import Motion
from retarget.options import RunOptions
from retarget.physics_options import PhysicsOptions
from retarget.recording.file import RecordingFile
from retarget.recording.reading import read_recording
from retarget.save import write_npz
from support.messages import refuses, shows

SINGLE = 3e-7
"""Goals and the root are kept in single precision."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("export") / "run.mcap")


@pytest.fixture(scope="module")
def motion(run: Recorded) -> Motion:
    return read_run(run.path)


def saved(run: Recorded) -> Motion:
    path = run.path.with_suffix(".npz")
    if not path.exists():
        write_npz(run.result, path)
    return read_run(path)


def test_rows_are_those_of_the_run_that_was_saved(run: Recorded, motion: Motion) -> None:
    then = saved(run)
    assert motion.joint_names == then.joint_names and motion.robot == then.robot == "op3"
    assert motion.notes == () and motion.row == "tick" and motion.rate_hz == 125.0
    np.testing.assert_allclose(motion.time, then.time, atol=1e-12)
    np.testing.assert_array_equal(motion.phase, then.phase)
    np.testing.assert_allclose(motion.q, then.q, atol=SINGLE)
    for ours, theirs in ((motion.goal_ticks, then.goal_ticks), (motion.servos, then.servos)):
        assert ours is not None and theirs is not None
        np.testing.assert_array_equal(ours, theirs)


def test_landmarks_are_those_that_were_kept_and_a_straight_line_between(run: Recorded, motion: Motion) -> None:
    then = saved(run)
    assert motion.asked is not None and then.asked is not None
    order = [motion.asked.names.index(name) for name in then.asked.names]
    assert sorted(motion.asked.names) == sorted(then.asked.names)
    followed = np.flatnonzero(motion.phase == "follow")
    ours, theirs = motion.asked.position[followed][:, order], then.asked.position[followed]
    kept = (followed + 1) % 5 == 0  # of cycles, the first of which arms
    np.testing.assert_allclose(ours[kept], theirs[kept], atol=1e-5)
    between = slice(int(np.argmax(kept)), len(kept) - int(np.argmax(kept[::-1])))
    bend = np.abs(np.diff(ours[between], n=2, axis=0)).max(axis=(1, 2))
    assert (bend[~kept[between][1:-1]] < 1e-9).all() and np.abs(ours - theirs).max() < 0.01


@pytest.mark.parametrize("form", FORMATS)
def test_every_format_takes_it(form: str, motion: Motion, tmp_path: Path) -> None:
    followed = motion.rows(motion.phase == "follow")
    place = export_place(FORMATS[form], tmp_path / "run.mcap", None)
    export_motion(followed, FORMATS[form], place)
    assert place.exists()


def test_the_human_is_as_often_as_it_was_kept(run: Recorded) -> None:
    human, then = read_run(run.path, of_human=True), run.result.record.human
    assert human.robot == "human" and human.row == "posture that was kept" and human.rate_hz == 12.5
    shows(human.notes[0], "12.5")
    rows = np.searchsorted(run.result.record.time, human.time - 1e-9)
    np.testing.assert_allclose(run.result.record.time[rows], human.time, atol=1e-9)
    np.testing.assert_allclose(human.q, then.q[rows], atol=3e-6)


def test_a_human_alone_has_every_tick(tmp_path: Path) -> None:
    alone = record(tmp_path / "run.mcap", options=RunOptions(robot="human", bus="none"), seconds=0.2)
    write_npz(alone.result, tmp_path / "run.npz")
    for of_human in (False, True):
        ours, then = read_run(alone.path, of_human=of_human), read_run(tmp_path / "run.npz", of_human=of_human)
        assert ours.robot == "human" and len(ours) == len(then) and ours.notes == ()
        np.testing.assert_allclose(ours.time, then.time, atol=1e-12)
        np.testing.assert_allclose(ours.q, then.q, atol=3e-6)
    sensors = read_run(alone.path).asked
    assert sensors is not None
    asked = [alone.result.clip.sample(tick).position for tick in range(alone.result.clip.ticks)]
    np.testing.assert_array_equal(sensors.position, asked)


def test_a_root_that_stands_still_is_a_root_all_the_same(tmp_path: Path) -> None:
    """Bolted to a stand: the tree of the run has no free joint, that of a motion has."""
    options = RunOptions(robot="op3", bus="physics", physics=PhysicsOptions(mount="stand"))
    held = record(tmp_path / "run.mcap", options=options, seconds=0.1)
    write_npz(held.result, tmp_path / "run.npz")
    ours, then = read_run(held.path), read_run(tmp_path / "run.npz")
    assert ours.body.nq == ours.body.nv + 1
    np.testing.assert_allclose(ours.q, then.q, atol=SINGLE)


def test_without_servos_that_answer_there_are_none(tmp_path: Path) -> None:
    none = record(tmp_path / "run.mcap", options=RunOptions(robot="op3", bus="none"), seconds=0.1)
    assert read_run(none.path).servos is None


def test_the_body_of_then_is_used_and_another_can_be_given(run: Recorded, motion: Motion, tmp_path: Path) -> None:
    assert run.result.robot is not None
    body = tmp_path / "moved.xml"
    body.write_bytes(run.result.robot.profile.body_path.read_bytes())
    given = read_run(run.path, body=body)
    assert given.body.source == str(body)
    np.testing.assert_array_equal(given.q, motion.q)
    with refuses(InputError):
        read_run(run.path, body=tmp_path / "nothing.xml")


def test_half_a_recording_is_exported_with_a_word(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("retarget.recording.writing.FLUSH_S", 0.01)
    whole = record(tmp_path / "run.mcap")
    content = whole.path.read_bytes()
    whole.path.write_bytes(content[: len(content) * 3 // 4])
    with pytest.raises(SystemExit) as left:
        main(["export", str(whole.path), "--to", "csv", "--phase", "all"])
    assert left.value.code == 0
    shows(capsys.readouterr().err)
    rows = (tmp_path / "run.csv").read_text().count("\n") - 1
    assert 0 < rows < len(whole.result.record)


def test_a_recording_without_ticks_is_refused(run: Recorded, tmp_path: Path) -> None:
    path = tmp_path / "none.mcap"
    file = RecordingFile(path, read_recording(run.path).session, [])
    file.announce([])
    file.finish()
    for of_human in (False, True):
        with refuses(InputError, found="/tick"):
            read_run(path, of_human=of_human)
