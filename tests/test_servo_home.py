"""`retarget servo home` as a user meets it, on the mock bus: questions, table, file, refusals, Ctrl-C."""

import io
from pathlib import Path

import numpy as np
import pytest

from hardware.bus import ServoBus
from hardware.clock import Clock
from retarget.catalogue import calibration_path
from retarget.cli import main
from retarget.cli import servo as servo_group
from retarget.cli.servo import home as home_file
from retarget.robot_body import RobotBody, load_robot
from retarget.servo_calibration import previous_path
from sim.mock_bus import MockBus


@pytest.fixture(autouse=True)
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's configuration folder, empty."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    return tmp_path


class Lab:
    """A robot whose first servos stand `shift` ticks off the profile's zero, and the words that a person types."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self._patch, self._capsys = monkeypatch, capsys
        self.shift: dict[int, int] = {}
        self.buses: list[MockBus] = []
        monkeypatch.setattr(home_file, "make_bus", self._make)

    def _make(self, name: str, robot: RobotBody, clock: Clock) -> ServoBus:
        angles = robot.posture(robot.profile.postures.neutral)[robot.servo_columns]
        start = robot.joint_map.to_ticks(angles)
        for column, ticks in self.shift.items():
            start[column] += ticks
        self.buses.append(MockBus(robot.joint_map.servos, clock, start=start))
        return self.buses[-1]

    def home(self, *words: str, typed: str = "\n\n\n") -> tuple[int, str, str]:
        self._patch.setattr("sys.stdin", io.StringIO(typed))
        with pytest.raises(SystemExit) as left:
            main(["servo", "home", "--robot", "op3", "--bus", "mock", *words])
        out, err = self._capsys.readouterr()
        return int(left.value.code or 0), out, err

    def closed(self) -> bool:
        """Whether every bus was closed: then it takes no call."""
        return all(not bus._open and not bus.torque_on for bus in self.buses)


@pytest.fixture
def lab(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Lab:
    return Lab(monkeypatch, capsys)


def test_home_writes_what_it_shows(lab: Lab) -> None:
    lab.shift = {0: 30, 19: -12}
    code, out, err = lab.home()
    assert (code, err) == (0, "")
    assert "+0.046" in out and "-0.018" in out and f"calibration: {calibration_path('op3')}" in out.replace("\n", "")
    zeros = [servo.zero_tick for servo in load_robot("op3").joint_map.servos]
    assert (zeros[0], zeros[1], zeros[19]) == (2078, 2048, 2036)
    assert lab.closed()


def test_some_joints_are_added_to_the_others(lab: Lab) -> None:
    lab.shift = {18: 30, 19: 40}
    lab.home()
    lab.shift = {18: 50, 19: 60}
    code, out, _ = lab.home("--joints", "head_tilt")
    assert code == 0 and "head_pan" not in out
    assert [servo.zero_tick for servo in load_robot("op3").joint_map.servos[18:]] == [2078, 2108]
    assert previous_path(calibration_path("op3")).exists()


@pytest.mark.parametrize("typed", ["n\n", "\nn\n", "\n\nn\n", "what\nNO\n"])
def test_no_writes_nothing(typed: str, lab: Lab) -> None:
    code, out, _ = lab.home(typed=typed)
    assert code == 0 and out.rstrip().endswith("nothing was written")
    assert not calibration_path("op3").exists() and lab.closed()


def test_nobody_there_is_refused(lab: Lab) -> None:
    code, _, err = lab.home(typed="\n")
    assert code == 2 and "nobody answers" in err
    assert not calibration_path("op3").exists() and lab.closed()


def test_far_from_the_profile_needs_force(lab: Lab) -> None:
    lab.shift = {18: 300}
    code, out, err = lab.home()
    assert code == 2 and "far off" in out and "head_pan +0.460 rad" in err and "--force" in err
    assert not calibration_path("op3").exists()
    code, _, _ = lab.home("--force")
    assert code == 0 and load_robot("op3").joint_map.servos[18].zero_tick == 2348


def test_zeros_that_no_servo_can_serve_are_refused(lab: Lab) -> None:
    lab.shift = {18: 1500}
    code, _, err = lab.home("--force")
    assert code == 2 and "cannot reach the joints' limits" in err and "head_pan" in err


@pytest.mark.parametrize("at", [0, 1, 2])
def test_ctrl_c_at_any_question_leaves_nothing_behind(at: int, lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def interrupt(question: str) -> bool:
        asked.append(question)
        if len(asked) > at:
            raise KeyboardInterrupt
        return True

    monkeypatch.setattr(home_file, "ask", interrupt)
    code, _, err = lab.home()
    assert (code, err) == (130, "interrupted\n")
    assert not calibration_path("op3").exists() and lab.closed()


def test_a_dry_run_touches_nothing(lab: Lab) -> None:
    code, out, _ = lab.home("--dry-run", "--pose", "stand", "--joints", "l_knee,r_knee")
    assert code == 0 and lab.buses == []
    assert "torque off on all 20 servos" in out and "read 2 of them in the posture 'stand'" in out
    assert "l_knee 0.6" in out and not calibration_path("op3").exists()


def test_the_file_of_another_robot_is_replaced_as_a_whole_only(lab: Lab) -> None:
    path = calibration_path("op3")
    path.parent.mkdir(parents=True)
    path.write_text("robot: poppy\nservos: {}\n")
    code, _, err = lab.home("--joints", "head_tilt")
    assert code == 2 and "of another robot" in err and lab.buses == []
    assert lab.home()[0] == 0
    assert load_robot("op3").calibration is not None and "poppy" in previous_path(path).read_text()


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--pose", "sitting"), "unknown posture; found 'sitting'; allowed: neutral, stand, rest, attractor"),
        (("--joints", "tail"), "unknown joints; found tail"),
        (("--bus", "none"), "there is no servo to read"),
        (("--bus", "mok"), "unknown bus"),
        (("--robot", "op4"), "Did you mean op3?"),
    ],
)
def test_bad_options_are_refused_before_a_bus_is_opened(words: tuple[str, ...], text: str, lab: Lab) -> None:
    code, _, err = lab.home(*words)
    assert code == 2 and text in err and lab.buses == []


def test_the_group_lists_its_commands(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["servo", "--help"])
    assert left.value.code == 0
    out = capsys.readouterr().out
    assert all(name in out and line[:40] in out for name, line in servo_group.COMMANDS.items())


def test_an_unknown_command_of_the_group_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["servo", "hone"])
    assert left.value.code == 2 and "home" in capsys.readouterr().err


def test_a_posture_of_zeros_is_told_in_short(lab: Lab) -> None:
    robot = load_robot("op3")
    assert home_file._angles(robot, np.zeros(20)) == "all joints at 0"


OPENING = (
    "device 200 switches the servos' power on, servos without torque get the profile's operating mode, return delay"
)


def test_a_dry_run_says_what_opening_writes(lab: Lab) -> None:
    code, out, _ = lab.home("--dry-run")
    assert code == 0 and OPENING in out and "(EEPROM)" in out and lab.buses == []


@pytest.mark.parametrize("bus", ["profile", "/dev/ttyUSB7"])
def test_a_real_bus_is_opened_only_after_that_was_said_and_agreed_to(bus: str, lab: Lab) -> None:
    code, out, _ = lab.home("--bus", bus, typed="n\n")
    assert code == 0 and f"The bus is opened: {OPENING}" in out and out.rstrip().endswith("nothing was written")
    assert lab.buses == [] and not calibration_path("op3").exists()
    code, _, err = lab.home("--bus", bus, typed="\n\n")
    assert code == 2 and "nobody answers" in err and len(lab.buses) == 1
