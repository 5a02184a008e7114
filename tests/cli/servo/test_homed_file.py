"""Where zeros are kept, by what the servos are and what was asked for."""

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from messages import refuses, shows
from retarget.cli.servo.home import HomedFile
from retarget.errors import UsageError
from retarget.model.robot import load_profile
from retarget.run.options import RunOptions
from retarget.schema.catalogue import calibration_path
from retarget.schema.profile import RobotProfile


@pytest.fixture(autouse=True)
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's configuration folder, empty."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    return tmp_path


@pytest.fixture
def op3() -> RobotProfile:
    return load_profile("op3")


@pytest.fixture
def terminal(own: Path) -> Iterator[str]:
    """A pseudo-terminal."""
    master, client = os.openpty()
    yield os.ttyname(client)
    os.close(client)
    os.close(master)


def of(profile: RobotProfile, bus: str, out: Path | None = None) -> HomedFile:
    return HomedFile.of(profile, RunOptions(robot="op3", bus=bus), out)


def test_real_servos_make_the_calibration_unless_a_file_is_named(op3: RobotProfile, own: Path) -> None:
    usual = of(op3, "profile")
    assert (usual.path, usual.own, usual.notice, usual.doubts) == (calibration_path("op3"), True, "", [])
    named = of(op3, "profile", own / "a.yaml")
    assert (named.path, named.own) == (own / "a.yaml", False)
    shows(named.notice, "a.yaml")
    assert of(op3, "profile", calibration_path("op3")) == usual


def test_simulated_servos_never_do(op3: RobotProfile, own: Path) -> None:
    assert of(op3, "emulator").path is None and of(op3, "mock").path is None
    assert of(op3, "emulator", own / "a.yaml") == HomedFile(own / "a.yaml", own=False, real=False)
    calibration_path("op3").parent.mkdir(parents=True)
    (own / "link").symlink_to(calibration_path("op3"))
    for same in (calibration_path("op3"), own / "link"):
        with refuses(UsageError):
            of(op3, "mock", same)


def test_a_port_of_the_profile_is_doubted_as_one_of_the_command_line(op3: RobotProfile, terminal: str) -> None:
    main = op3.buses["main"].model_copy(update={"port": terminal})
    written = op3.model_copy(update={"buses": {"main": main}})
    for file in (of(op3, terminal), of(written, "profile")):
        assert len(file.doubts) == 1 and file.doubts[0].startswith(f"{terminal} leads to a pseudo-terminal")
        assert replace(file, own=False).doubts == []
    assert of(written, "/dev/ttyUSB0").doubts == []


def test_a_named_file_that_is_there_is_kept_unless_asked(op3: RobotProfile, own: Path) -> None:
    """The robot's own calibration is replaced all the same: the one before stays beside it."""
    there = own / "a.yaml"
    there.write_text("mine")
    for bus in ("profile", "mock"):
        with refuses(UsageError, "--out", "a.yaml", "--overwrite"):
            of(op3, bus, there)
        assert HomedFile.of(op3, RunOptions(robot="op3", bus=bus), there, overwrite=True).path == there
    assert there.read_text() == "mine"
    usual = calibration_path("op3")
    usual.parent.mkdir(parents=True)
    usual.write_text("before")
    assert of(op3, "profile").path == of(op3, "profile", usual).path == usual
