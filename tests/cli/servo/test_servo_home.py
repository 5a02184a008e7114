"""`retarget servo home` as a user meets it, on mock servos that pass for real ones, and on emulated ones."""

import io
import os
import signal
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import pytest

from command_line import said_by
from hardware.bus import ServoBus
from hardware.clock import Clock, VirtualClock
from messages import shows
from retarget.cli.buses import make_bus, posture_ticks
from retarget.cli.exit import REFUSED
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


def zeros_of(*columns: int) -> list[int]:
    """Ticks of the zeros of some joints, as they are read from then on."""
    servos = load_robot("op3").joint_map.servos
    return [servos[column].zero_tick for column in columns]


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

    def home(self, *words: str, typed: str = YES, code: int = 0) -> tuple[str, str]:
        """The output of a command that ends by this code; only a refusal has something on stderr."""
        self._patch.setattr("sys.stdin", io.StringIO(typed))
        found, out, err = said_by(self._capsys, "servo", "home", "--robot", "op3", *words)
        assert found == code and (code or not err), out + err
        return out, err

    def refuses(self, *words: str) -> str:
        """The message of a command that is refused before a bus is opened."""
        _, err = self.home(*words, code=REFUSED)
        assert self.buses == []
        return err

    def closed(self) -> bool:
        """Whether every bus was closed: then it takes no call."""
        return all(not bus._open and not bus.torque_on for bus in self.buses)


@pytest.fixture
def lab(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Lab:
    return Lab(monkeypatch, capsys)


def test_home_writes_what_it_shows(lab: Lab) -> None:
    lab.shift = {0: 30, 19: -12}
    out, _ = lab.home()
    assert "+0.046" in out and "-0.018" in out
    shows(out.replace("\n", "  "), calibration_path("op3"))
    assert zeros_of(0, 1, 19) == [2078, 2048, 2036] and lab.closed()


def test_joint_after_joint_what_was_read_is_kept_and_the_rest_goes_on_later(lab: Lab) -> None:
    lab.shift = {0: 30, 2: -12, 3: 300, 19: 7}
    joints = load_robot("op3").joint_map.joints
    out, _ = lab.home("--each", typed="y\ny\nwhat\ne\n")
    assert out.rstrip().endswith("nothing was written") and not calibration_path("op3").exists()
    # opened, limp, two read, one left out, one that is far off twice, the end, written
    out, _ = lab.home("--each", typed="y\ny\n\n\ns\n\n\ne\ny\n")
    shows(out.split("joint  ")[0], "[4/20] again: hold l_sho_roll (id 4)", "+0.460 rad off")
    assert out.rstrip().endswith(f"--each --joints {','.join(joints[2:])}") and lab.closed()
    assert zeros_of(0, 1, 2, 3, 19) == [2078, 2048, 2048, 2048, 2048]
    out, _ = lab.home("--each", "--joints", "r_sho_roll,head_tilt", typed="y\ny\n\n\ny\n")
    assert "--joints" not in out and zeros_of(0, 2, 19) == [2078, 2036, 2055]


def test_far_from_the_profile_needs_force_and_what_no_servo_can_serve_is_refused(lab: Lab) -> None:
    lab.shift = {18: 1500}
    shows(lab.home("--force", code=REFUSED)[1], "head_pan")
    lab.shift = {18: 300}
    out, err = lab.home(code=REFUSED)
    shows(out)
    shows(err, "head_pan", "+0.460", "--force")
    assert not calibration_path("op3").exists()
    lab.home("--force")
    assert zeros_of(18) == [2348]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("at", [0, 1, 2, 3])
def test_a_signal_at_any_question_leaves_nothing_behind(
    at: int, number: signal.Signals, lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = chain([True] * at, iter(lambda: signal.raise_signal(number), True))
    monkeypatch.setattr(home_file, "confirmed", lambda question, *, enter, where: next(answers))
    assert lab.home(code=130)[1] == "interrupted\n"
    assert not calibration_path("op3").exists() and lab.closed()


def test_a_dry_run_touches_nothing(lab: Lab) -> None:
    out, _ = lab.home("--dry-run", "--pose", "stand", "--joints", "l_knee,r_knee")
    shows(out, 20, 2, "'stand'")
    assert lab.buses == [] and "l_knee 0.6" in out and not calibration_path("op3").exists()


def test_the_file_of_another_robot_is_replaced_as_a_whole_only(lab: Lab) -> None:
    path = calibration_path("op3")
    path.parent.mkdir(parents=True)
    path.write_text("robot: poppy\nservos: {}\n")
    shows(lab.refuses("--joints", "head_tilt"))
    lab.home()
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
    assert text in lab.refuses(*words)


OPENING = (
    "device 200 switches the servos' power on, servos without torque get the profile's operating mode, return delay"
)


@pytest.mark.parametrize("words", [(), ("--bus", "/dev/ttyUSB7"), ("--port", "/dev/ttyUSB7")])
def test_a_real_bus_is_opened_only_after_that_was_said_and_agreed_to(words: tuple[str, ...], lab: Lab) -> None:
    out, _ = lab.home(*words, typed="\n")
    assert out.rstrip().endswith("nothing was written") and lab.buses == []
    shows(out, OPENING)
    lab.home(*words, typed="y\n\n")
    assert len(lab.buses) == 1 and not calibration_path("op3").exists()


def _files(folder: Path) -> list[str]:
    return sorted(str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file())


@pytest.mark.parametrize("bus", ["mock", "emulator"])
def test_of_servos_that_are_simulated_nothing_is_kept(bus: str, lab: Lab, own: Path) -> None:
    lab.shift = {0: 30}
    out, _ = lab.home("--bus", bus, typed="y\n\n")
    first, *_, last = out.splitlines()
    assert "+0.046" in out and lab.closed()
    assert first.startswith("These servos are simulated: all steps run, and nothing is kept; --out FILE")
    assert last.startswith("nothing was kept: these servos are simulated")
    assert _files(own) == []
    out, _ = lab.home("--bus", bus, "--dry-run")
    assert "write" not in out.split("and keep nothing")[1]
    shows(out)


@pytest.mark.parametrize("words", [(), ("--pose", "stand")])
def test_all_steps_run_on_an_emulator_and_enter_alone_never_switches_torque_off(
    words: tuple[str, ...], own: Path, lab: Lab
) -> None:
    lab.real()
    out, _ = lab.home("--bus", "emulator", *words, typed="\n")
    assert out.rstrip().endswith("Go on? [y/N] nothing was written")
    out, _ = lab.home("--bus", "emulator", *words, typed="y\n\n")
    assert _files(own) == []
    shows(out)


@pytest.mark.parametrize("bus", ["emulator", "profile"])
def test_a_file_that_is_named_is_the_only_one_that_is_written(bus: str, lab: Lab, own: Path) -> None:
    lab.home()
    before, zeros = calibration_path("op3").read_bytes(), own / "zeros.yaml"
    words = ("--bus", bus, "--out", str(zeros))
    lab.shift = {0: 30}
    for word, more in (("", ()), (", which is there already", ("--overwrite",))):
        out, _ = lab.home(*words, *more, typed="y\n" * 4)
        shows(out.replace("\n", "  "), f"{zeros}{word}")
        assert f"{zeros}" in out.splitlines()[0]
    lab.buses.clear()
    shows(lab.refuses(*words), "--overwrite")
    assert "tick: 2078" in zeros.read_text() and calibration_path("op3").read_bytes() == before
    assert _files(own) == [str(calibration_path("op3").relative_to(own)), "zeros.yaml"]


def test_a_file_that_cannot_be_is_refused_before_a_bus_is_opened(lab: Lab, own: Path) -> None:
    calibration_path("op3").parent.mkdir(parents=True)
    (own / "link").symlink_to(calibration_path("op3"))
    for file in (own / "none" / "zeros.yaml", calibration_path("op3"), own / "link"):
        shows(lab.refuses("--bus", "emulator", "--out", str(file)), "--out")
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
    out, _ = lab.home("--port", str(terminal), typed="\n")
    assert lab.buses == [] and out.rstrip().endswith("nothing was written")
    doubt = f"{terminal} leads to a pseudo-terminal ({terminal.readlink()}) and looks like an emulator"
    assert out.startswith(f"{doubt}. What an emulator says is no calibration") and "[y/N]" in out
    out, _ = lab.home("--port", str(terminal), typed="y\ny\ny\n\n\n")
    shows(out, calibration_path("op3"), doubt, "y/N")
    assert not calibration_path("op3").exists()
    lab.home("--port", str(terminal), typed="y\n" * 5)
    assert calibration_path("op3").exists()
