"""The calibration of one specimen: written and read back, applied to the right robot only, never half written."""

import shutil
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus_rig import four_servos, waist_servos
from hardware.joint_map import JointMap
from hardware.servo import ServoSpec
from messages import refuses, shows
from retarget.cli import main
from retarget.errors import ConfigError, UsageError
from retarget.model.robot import load_profile, load_robot, load_uncalibrated
from retarget.schema.catalogue import calibration_path
from retarget.schema.files import previous_path
from retarget.schema.profile import RobotProfile
from retarget.schema.servo_calibration import (
    HomedServo,
    ServoCalibration,
    calibrated,
    impossible_zeros,
    read_calibration,
    write_calibration,
)
from retarget.schema.strict_yaml import read_text, scan


@pytest.fixture(autouse=True)
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's configuration folder, empty."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    return tmp_path / "retarget"


@pytest.fixture(scope="module")
def op3() -> RobotProfile:
    return load_profile("op3")


def entry(number: int, tick: int, *, angle: float = 0.0, **more: object) -> HomedServo:
    fields = {"id": number, "model": "XM430-W350", "posture": "neutral", "angle": angle, "tick": tick}
    return HomedServo.model_validate(fields | {"date": "2026-01-31"} | more)


def head(**more: object) -> ServoCalibration:
    servos = {"head_pan": entry(19, 2100), "head_tilt": entry(20, 1900, angle=0.25)}
    return ServoCalibration.model_validate({"robot": "op3", "servos": servos} | more)


def test_what_is_written_is_read_and_a_write_that_fails_leaves_the_old_one(
    op3: RobotProfile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert read_calibration(op3) is None
    path = write_calibration(head())
    assert path == calibration_path("op3") and not previous_path(path).exists()
    own, named = path.read_bytes(), tmp_path / "named" / "zeros.yaml"
    named.parent.mkdir()
    for tick in (2200, 2300):  # a file that is named is the only one that is written
        assert write_calibration(head(servos={"head_pan": entry(19, tick)}), named) == named
        assert f"tick: {tick}" in named.read_text()
    assert list(named.parent.iterdir()) == [named]
    broken = Mock(side_effect=OSError(28, "No space left on device"))
    monkeypatch.setattr("retarget.schema.files.os.fsync", broken)
    with refuses(UsageError):
        write_calibration(head(servos={"head_pan": entry(19, 2200)}))
    assert read_calibration(op3) == head()
    assert path.read_bytes() == own and list(path.parent.iterdir()) == [path]


LETTERS = st.characters(exclude_categories=["Cs", "Cc", "Z"], exclude_characters="/\\\ufeff")


@given(joint=st.text(LETTERS, min_size=1, max_size=8), angle=st.floats(-7.0, 7.0), tick=st.integers(-20000, 20000))
def test_any_name_and_number_survives_the_file(joint: str, angle: float, tick: int) -> None:
    calibration = ServoCalibration(robot="op3", servos={joint: entry(3, tick, angle=angle, homing_offset=-7)})
    with TemporaryDirectory() as folder:
        path = write_calibration(calibration, Path(folder) / "zeros.yaml")
        document = scan(read_text(path), path)
    assert not document.problems and ServoCalibration.model_validate(document.data) == calibration


def test_a_calibrated_robot_has_its_zeros_there() -> None:
    write_calibration(head())
    robot, plain = load_robot("op3"), load_uncalibrated("op3")
    assert robot.calibration == head() and plain.calibration is None
    zeros = {servo.joint: servo.zero_tick for servo in robot.joint_map.servos}
    assert zeros["head_pan"] == 2100
    assert zeros["head_tilt"] == round(1900 - 0.25 * 2048 / np.pi)
    assert {zero for joint, zero in zeros.items() if not joint.startswith("head")} == {2048}
    assert [servo.zero_tick for servo in plain.joint_map.servos] == [2048] * 20


@pytest.mark.parametrize("servos", [four_servos(), waist_servos()], ids=["plain", "coupled"])
@given(data=st.data())
def test_the_tick_read_then_is_the_angle_of_then(servos: tuple[ServoSpec, ...], data: st.DataObject) -> None:
    share = np.array(data.draw(st.lists(st.floats(0.3, 0.7), min_size=4, max_size=4)))
    moved = data.draw(st.lists(st.integers(-80, 80), min_size=4, max_size=4))
    truth = JointMap([replace(spec, zero_tick=spec.zero_tick + by) for spec, by in zip(servos, moved, strict=True)])
    asked = truth.lower + share * (truth.upper - truth.lower)
    ticks = truth.to_ticks(asked)
    placed = truth.to_radians(ticks)
    homed = {
        spec.joint: entry(spec.id, int(tick), angle=float(angle), model=spec.model.name)
        for spec, tick, angle in zip(servos, ticks, placed, strict=True)
    }
    found = calibrated(servos, ServoCalibration(robot="r", servos=homed))
    assert [spec.zero_tick for spec in found] == [spec.zero_tick for spec in truth.servos]


WRONG: dict[str, dict[str, object]] = {
    "joint": {"tail": entry(19, 2048)},
    "id": {"head_pan": entry(18, 2048)},
    "model": {"head_pan": entry(19, 2048, model="XL430-W250")},
    "offset": {"head_pan": entry(19, 2048, homing_offset=4)},
    "travel": {"head_pan": entry(19, 200)},
    "all": {"head_pan": entry(18, 1), "head_tilt": entry(19, 1), "tail": entry(3, 3)},
}


@pytest.mark.parametrize("case", WRONG)
def test_of_another_robot_is_refused(case: str) -> None:
    write_calibration(head(servos=WRONG[case]))
    with refuses(ConfigError) as refusal:
        load_robot("op3")
    assert len(refusal.value.problems) == (3 if case == "all" else 1)


def test_the_file_of_another_robot_or_an_unsound_one_is_refused(op3: RobotProfile) -> None:
    path = calibration_path("op3")
    write_calibration(head(robot="poppy"))
    shutil.move(calibration_path("poppy"), path)
    with refuses(ConfigError, found="poppy", allowed="op3"):
        load_robot("op3")
    for text in ("", "robot: op3\n", "robot: op3\nservos: {}\n", "[", "robot: op3\nservos: {head_pan: {id: 19}}\n"):
        path.write_text(text)
        with pytest.raises(ConfigError):
            read_calibration(op3)


def test_half_a_pair_shifted_beyond_its_servo_is_impossible() -> None:
    def impossible(tick: int) -> list[tuple[str, str]]:
        return impossible_zeros(waist_servos(), ServoCalibration(robot="r", servos={"knee": entry(7, tick)}))

    assert impossible(2048) == []
    ((joint, text),) = impossible(100)
    assert joint == "knee"
    shows(text)


def test_check_shows_it(capsys: pytest.CaptureFixture[str]) -> None:
    """That there is none is in the messages of `tests/cli/test_check.py`."""
    write_calibration(head())
    with pytest.raises(SystemExit):
        main(["check", "op3"])
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "calibration:" in line]
    shows(line, 2, 20, "2026-01-31")
