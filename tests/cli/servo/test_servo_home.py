"""`retarget servo home` as a user meets it, on mock servos that pass for real ones: questions, table, file, refusals,
Ctrl-C. Those of an emulator leave nothing behind."""

import io
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from hardware.bus import ServoBus
from hardware.clock import Clock, VirtualClock
from messages import shows
from retarget.cli import main
from retarget.cli.buses import make_bus, posture_ticks
from retarget.cli.servo import home as home_file
from retarget.model.robot import RobotBody, load_robot
from retarget.schema.catalogue import calibration_path
from retarget.schema.files import previous_path
from sim.mock_bus import MockBus


@pytest.fixture(autouse=True)
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's configuration folder, empty."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    return tmp_path


YES = "y\ny\n\ny\n"
"""To: open the bus, torque off, read now, write."""


class Lab:
    """A robot whose first servos stand `shift` ticks off the profile's zero, and the words that a person types."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self._patch, self._capsys = monkeypatch, capsys
        self.shift: dict[int, int] = {}
        self.buses: list[MockBus] = []
        monkeypatch.setattr(home_file, "make_bus", self._make)
        monkeypatch.setattr(home_file, "MonotonicClock", VirtualClock)

    def real(self) -> None:
        """The buses of the command line, instead of ours."""
        self._patch.setattr(home_file, "make_bus", make_bus)

    def _make(self, name: str, robot: RobotBody, clock: Clock, *, posture: str) -> ServoBus:
        start = posture_ticks(robot, "neutral")
        for column, ticks in self.shift.items():
            start[column] += ticks
        self.buses.append(MockBus(robot.joint_map.servos, clock, start=start))
        return self.buses[-1]

    def home(self, *words: str, typed: str = YES) -> tuple[int, str, str]:
        self._patch.setattr("sys.stdin", io.StringIO(typed))
        with pytest.raises(SystemExit) as left:
            main(["servo", "home", "--robot", "op3", *words])
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
    assert "+0.046" in out and "-0.018" in out
    shows(out.replace("\n", "  "), calibration_path("op3"))
    zeros = [servo.zero_tick for servo in load_robot("op3").joint_map.servos]
    assert (zeros[0], zeros[1], zeros[19]) == (2078, 2048, 2036)
    assert lab.closed()


def test_joint_after_joint_what_was_read_is_kept_and_the_rest_goes_on_later(lab: Lab) -> None:
    lab.shift = {0: 30, 2: -12, 3: 300, 19: 7}
    joints = load_robot("op3").joint_map.joints
    # opened, limp, two read, one left out, one that is far off twice, the end, written
    code, out, err = lab.home("--each", typed="y\ny\n\n\ns\n\n\ne\ny\n")
    assert (code, err) == (0, "") and lab.closed()
    shows(out.split("joint  ")[0], "[4/20] again: hold l_sho_roll (id 4)", "+0.460 rad off")
    assert out.rstrip().endswith(f"--each --joints {','.join(joints[2:])}")
    zeros = [servo.zero_tick for servo in load_robot("op3").joint_map.servos]
    assert (zeros[0], zeros[1], zeros[2], zeros[3], zeros[19]) == (2078, 2048, 2048, 2048, 2048)
    code, out, _ = lab.home("--each", "--joints", "r_sho_roll,head_tilt", typed="y\ny\n\n\ny\n")
    assert code == 0 and "--joints" not in out
    zeros = [servo.zero_tick for servo in load_robot("op3").joint_map.servos]
    assert (zeros[0], zeros[2], zeros[19]) == (2078, 2036, 2055)


def test_joint_after_joint_nothing_read_is_nothing_written(lab: Lab) -> None:
    code, out, _ = lab.home("--each", typed="y\ny\nwhat\ne\n")
    assert code == 0 and out.rstrip().endswith("nothing was written") and not calibration_path("op3").exists()


def test_far_from_the_profile_needs_force(lab: Lab) -> None:
    lab.shift = {18: 300}
    code, out, err = lab.home()
    assert code == 2
    shows(out)
    shows(err, "head_pan", "+0.460", "--force")
    assert not calibration_path("op3").exists()
    code, _, _ = lab.home("--force")
    assert code == 0 and load_robot("op3").joint_map.servos[18].zero_tick == 2348


def test_zeros_that_no_servo_can_serve_are_refused(lab: Lab) -> None:
    lab.shift = {18: 1500}
    code, _, err = lab.home("--force")
    assert code == 2
    shows(err, "head_pan")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("at", [0, 1, 2, 3])
def test_a_signal_at_any_question_leaves_nothing_behind(
    at: int, number: signal.Signals, lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def interrupt(question: str, *, enter: bool, where: str) -> bool:
        asked.append(question)
        if len(asked) > at:
            signal.raise_signal(number)
        return True

    monkeypatch.setattr(home_file, "confirmed", interrupt)
    code, _, err = lab.home()
    assert (code, err) == (130, "interrupted\n")
    assert not calibration_path("op3").exists() and lab.closed()


def test_a_dry_run_touches_nothing(lab: Lab) -> None:
    code, out, _ = lab.home("--dry-run", "--pose", "stand", "--joints", "l_knee,r_knee")
    assert code == 0 and lab.buses == []
    shows(out, 20, 2, "'stand'")
    assert "l_knee 0.6" in out and not calibration_path("op3").exists()


def test_the_file_of_another_robot_is_replaced_as_a_whole_only(lab: Lab) -> None:
    path = calibration_path("op3")
    path.parent.mkdir(parents=True)
    path.write_text("robot: poppy\nservos: {}\n")
    code, _, err = lab.home("--joints", "head_tilt")
    assert code == 2 and lab.buses == []
    shows(err)
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


OPENING = (
    "device 200 switches the servos' power on, servos without torque get the profile's operating mode, return delay"
)


@pytest.mark.parametrize("words", [(), ("--bus", "/dev/ttyUSB7"), ("--port", "/dev/ttyUSB7")])
def test_a_real_bus_is_opened_only_after_that_was_said_and_agreed_to(words: tuple[str, ...], lab: Lab) -> None:
    code, out, _ = lab.home(*words, typed="\n")
    assert code == 0 and out.rstrip().endswith("nothing was written")
    shows(out, OPENING)
    assert lab.buses == [] and not calibration_path("op3").exists()
    code, _, err = lab.home(*words, typed="y\n\n")
    assert (code, err, len(lab.buses)) == (0, "", 1)
    assert not calibration_path("op3").exists()


def _files(folder: Path) -> list[str]:
    return sorted(str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file())


@pytest.mark.parametrize("bus", ["mock", "emulator"])
def test_of_servos_that_are_simulated_nothing_is_kept(bus: str, lab: Lab, own: Path) -> None:
    lab.shift = {0: 30}
    code, out, err = lab.home("--bus", bus, typed="y\n\n")
    assert (code, err) == (0, "") and "+0.046" in out and lab.closed()
    first, last = out.splitlines()[0], out.splitlines()[-1]
    assert first.startswith("These servos are simulated: all steps run, and nothing is kept; --out FILE")
    assert last.startswith("nothing was kept: these servos are simulated")
    assert _files(own) == []
    code, out, _ = lab.home("--bus", bus, "--dry-run")
    assert code == 0 and "write" not in out.split("and keep nothing")[1]
    shows(out)


@pytest.mark.parametrize("words", [(), ("--pose", "stand")])
def test_all_steps_run_on_an_emulator(words: tuple[str, ...], own: Path, lab: Lab) -> None:
    lab.real()
    code, out, err = lab.home("--bus", "emulator", *words, typed="y\n\n")
    assert (code, err) == (0, "") and _files(own) == []
    shows(out)


def test_enter_alone_never_switches_torque_off(own: Path, lab: Lab) -> None:
    code, out, _ = lab.home("--bus", "emulator", typed="\n")
    assert code == 0 and out.rstrip().endswith("Go on? [y/N] nothing was written")


@pytest.mark.parametrize("words", [("--bus", "emulator"), ("--bus", "profile")])
def test_a_file_that_is_named_is_the_only_one_that_is_written(words: tuple[str, ...], lab: Lab, own: Path) -> None:
    lab.home()
    before = calibration_path("op3").read_bytes()
    lab.shift = {0: 30}
    for word, more in (("", ()), (", which is there already", ("--overwrite",))):
        code, out, err = lab.home(*words, "--out", str(own / "zeros.yaml"), *more, typed="y\n" * 4)
        assert (code, err) == (0, "")
        text = out.replace("\n", "  ")
        shows(text, f"{own / 'zeros.yaml'}{word}")
        assert f"{own / 'zeros.yaml'}" in out.splitlines()[0]
    assert "tick: 2078" in (own / "zeros.yaml").read_text()
    assert calibration_path("op3").read_bytes() == before
    assert _files(own) == [str(calibration_path("op3").relative_to(own)), "zeros.yaml"]


@pytest.mark.parametrize("bus", ["emulator", "profile"])
def test_a_named_file_that_is_there_is_refused_before_a_bus_is_opened(bus: str, lab: Lab, own: Path) -> None:
    (own / "zeros.yaml").write_text("mine")
    code, _, err = lab.home("--bus", bus, "--out", str(own / "zeros.yaml"))
    assert code == 2 and lab.buses == []
    shows(err, "--overwrite")
    assert (own / "zeros.yaml").read_text() == "mine"


def test_a_file_that_cannot_be_is_refused_before_a_bus_is_opened(lab: Lab, own: Path) -> None:
    code, _, err = lab.home("--bus", "emulator", "--out", str(own / "none" / "zeros.yaml"))
    assert code == 2 and lab.buses == []
    shows(err, "--out")
    calibration_path("op3").parent.mkdir(parents=True)
    (own / "link").symlink_to(calibration_path("op3"))
    for same in (calibration_path("op3"), own / "link"):
        code, _, err = lab.home("--bus", "emulator", "--out", str(same))
        assert code == 2 and lab.buses == []
        shows(err)
    assert _files(own) == []


@pytest.fixture
def terminal(own: Path) -> Iterator[Path]:
    """A link to a pseudo-terminal."""
    master, client = os.openpty()
    (own / "op3-port").symlink_to(os.ttyname(client))
    yield own / "op3-port"
    os.close(client)
    os.close(master)


def test_a_port_that_looks_like_an_emulator_is_doubted(lab: Lab, terminal: Path) -> None:
    code, out, _ = lab.home("--port", str(terminal), typed="\n")
    assert code == 0 and lab.buses == [] and out.rstrip().endswith("nothing was written")
    doubt = f"{terminal} leads to a pseudo-terminal ({terminal.readlink()}) and looks like an emulator"
    assert out.startswith(f"{doubt}. What an emulator says is no calibration") and "[y/N]" in out
    code, out, _ = lab.home("--port", str(terminal), typed="y\ny\ny\n\n\n")
    shows(out, calibration_path("op3"), doubt, "y/N")
    assert not calibration_path("op3").exists()
    code, out, _ = lab.home("--port", str(terminal), typed="y\n" * 5)
    assert code == 0 and calibration_path("op3").exists()
