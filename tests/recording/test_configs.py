"""The config files of a recorded run: those of then are used where they moved, changed or are gone; or those of now."""

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from messages import refuses
from recordings import Recorded, record
from retarget.errors import InputError
from retarget.recording.configs import PROFILE, as_recorded
from retarget.recording.mcap_writer import RecordingFile
from retarget.recording.reading import Recording, read_recording
from retarget.recording.replay import replay
from retarget.run.options import RunOptions
from retarget.schema.catalogue import shipped_folder

PRIORITIES = "priorities_of_the_robot.yaml"


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("own")


@pytest.fixture(scope="module")
def run(home: Path) -> Recorded:
    """Of a robot, a performer and priorities that are the user's own files, by path."""
    shutil.copytree(shipped_folder() / "robots" / "op3", home / "kept" / "op3")
    shutil.copy(shipped_folder() / "performers" / "five.yaml", home / "kept" / "five.yaml")
    shutil.copy(shipped_folder() / "priorities" / "servo.yaml", home / "kept" / "servo.yaml")
    shutil.copytree(home / "kept", home / "own")
    own = home / "own"
    options = RunOptions(
        robot=str(own / "op3"), performer=str(own / "five.yaml"), priorities=str(own / "servo.yaml"), bus="mock"
    )
    return record(home / "run.mcap", options=options, seconds=0.2)


@pytest.fixture(autouse=True)
def as_it_was(home: Path) -> Iterator[None]:
    yield
    shutil.rmtree(home / "own", ignore_errors=True)
    shutil.copytree(home / "kept", home / "own")


@pytest.fixture
def found(run: Recorded) -> Recording:
    return run.read()


@pytest.mark.long
def test_a_robot_that_is_gone_is_in_the_recording(found: Recording, home: Path) -> None:
    shutil.rmtree(home / "own")
    again = replay(found)
    assert again.difference.none, again.difference.lines()
    assert again.changed == ()


@pytest.mark.long
def test_a_robot_that_moved_is_named_and_then_all_is_as_it_is_now(found: Recording, home: Path) -> None:
    shutil.move(home / "own" / "op3", home / "elsewhere")
    with as_recorded(found, robot=str(home / "elsewhere")) as configs:
        assert configs.notes == () and not configs.attached
        assert replay(found, configs).difference.none
    shutil.rmtree(home / "elsewhere")


def test_a_changed_profile_is_found_only_where_it_is_asked_for(found: Recording, home: Path) -> None:
    path = home / "own" / "op3" / "robot.yaml"
    text = path.read_text()
    slower = text.replace("speed_caps: {follow: 1.0,", "speed_caps: {follow: 0.1,")
    assert slower != text
    path.write_text(slower)
    then = replay(found)
    assert then.difference.none
    assert then.changed == (f"{PROFILE} has changed since, {path}: the recorded one is used",)
    with as_recorded(found, robot=str(home / "own" / "op3")) as configs:
        now = replay(found, configs)
    assert now.changed == (f"{PROFILE} has changed: {path}",)
    assert not now.difference.none


def test_priorities_of_both_stages_come_back(found: Recording, home: Path) -> None:
    """The human's are named by the profile, the robot's by an option."""
    files = found.session.files
    elsewhere = tuple(
        file.model_copy(update={"path": "gone"}) if file.name.startswith("priorities") else file for file in files
    )
    session = found.session.model_copy(update={"files": elsewhere})
    recording = replace(found, session=session)
    (home / "own" / "servo.yaml").unlink()
    with as_recorded(recording) as configs:
        assert configs.attached == {PRIORITIES, "priorities_of_the_human.yaml"}
        assert configs.options.priorities is not None
        assert Path(configs.options.priorities).read_bytes() == recording.attachments[PRIORITIES]


@pytest.mark.long
def test_a_calibration_of_now_is_not_used_for_then(
    found: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    place = tmp_path / "retarget" / "calibrations" / "op3.yaml"
    place.parent.mkdir(parents=True)
    place.write_text("what is no calibration")
    again = replay(found)
    assert again.difference.none
    assert again.changed == ()


def test_what_is_nowhere_is_said_with_the_way_on(found: Recording, home: Path) -> None:
    shutil.rmtree(home / "own")
    bare = replace(found, attachments={})
    with refuses(InputError, "robot.yaml", "--robot", "NAME|FILE"), as_recorded(bare):
        pass
    without = {name: data for name, data in found.attachments.items() if name != "performer.yaml"}
    bare = replace(found, attachments=without)
    with refuses(InputError, "performer.yaml"), as_recorded(bare):
        pass


def test_files_of_another_version_are_refused_in_the_name_of_the_recording(found: Recording, home: Path) -> None:
    (home / "own" / "op3" / "robot.yaml").unlink()
    strange = {**found.attachments, PROFILE: b"name: op3\nlegs: 3\n"}
    strange_one = replace(found, attachments=strange)
    with refuses(InputError, "body", 13, "--robot", where="run.mcap", found="robot.yaml:1"), as_recorded(strange_one):
        pass


def test_an_attachment_that_is_not_what_was_said_is_none(found: Recording, tmp_path: Path) -> None:
    session = found.session
    said = {file.name: file for file in session.files}
    path = tmp_path / "strange.mcap"
    others = (said[PROFILE], b"another"), (said["body.xml"].model_copy(update={"name": "../body.xml"}), b"out of it")
    file = RecordingFile(path, session, [*others, (said["performer.yaml"], found.attachments["performer.yaml"])])
    file.announce([])
    file.finish()
    assert set(found.attachments) == set(said)
    assert set(read_recording(path).attachments) == {"performer.yaml"}


def test_nothing_stays_behind(found: Recording, home: Path) -> None:
    shutil.rmtree(home / "own")
    with as_recorded(found) as configs:
        assert configs.robot is not None
        body = configs.robot.profile.body_path
        assert body.is_file() and configs.body_attached
    assert not body.parent.exists()
