"""`retarget servo setup --all`: twenty new servos on the emulated wire, connected one by one, and what goes wrong."""

import signal
from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from typing import Any

import pytest

from hardware.bus import BusSpec
from hardware.dynamixel.checks import complaints, needed_ticks
from hardware.dynamixel.codec import Instruction
from hardware.dynamixel.settings import ServoImage
from hardware.servo import ServoSpec
from messages import refuses, shows
from retarget.cli.exit import echo
from retarget.cli.servo import find_port, places
from retarget.cli.servo.find_port import port_of_bus, unplugged_port
from retarget.model.robot import load_uncalibrated
from servo_lab import ServoLab
from sim.emulator.line import Line
from sim.emulator.robot_lines import connect

ROBOT = ("--robot", "op3", "--all", "--port", "emulator")
SERVOS = load_uncalibrated("op3").joint_map.servos
JOINTS = [servo.joint for servo in SERVOS]
XL430 = 1060


@pytest.fixture
def connected(monkeypatch: pytest.MonkeyPatch) -> list[Sequence[str]]:
    """The joints whose servos are on the line at each ENTER, in order; behind the last one, the one that is asked
    for."""
    planned: list[Sequence[str]] = []

    def planned_connect(lines: Mapping[str, Line], servos: Sequence[ServoSpec], joints: Sequence[str]) -> None:
        connect(lines, servos, planned.pop(0) if planned else joints)

    monkeypatch.setattr(places, "connect", planned_connect)
    return planned


def _begins_with(monkeypatch: pytest.MonkeyPatch, change: Callable[[], None]) -> None:
    """The servos of the lab are changed before a command begins."""
    make = places.emulated_lines

    def lines(*arguments: Any, **options: Any) -> dict[str, Line]:
        made = make(*arguments, **options)
        change()
        return made

    monkeypatch.setattr(places, "emulated_lines", lines)


def _put(lab: ServoLab, column: int, **registers: int) -> None:
    """Change registers of a servo, by its place in the robot."""
    device = lab.line.devices[column]
    for name, value in registers.items():
        device.memory.put(name, value)
    device.tune()


def _line(out: str, word: str) -> str:
    """The first line with a word."""
    return next(line for line in out.splitlines() if word in line)


def test_twenty_new_servos_are_set_up_one_at_a_time(lab: ServoLab) -> None:
    code, out, err = lab.run("setup", *ROBOT, typed="\n" * 20)
    assert (code, err) == (0, "")
    shows(out.split("[2/20]")[0])
    assert out.count("is set up: write") == 20
    shows(out.splitlines()[-1])
    (bus,) = load_uncalibrated("op3").profile.bus_specs()
    for servo, device in zip(SERVOS, lab.line.devices, strict=False):
        memory = lab.memory(servo.id)
        assert (device.id, device.baud, memory.value("torque_enable")) == (servo.id, 2_000_000, 0)
        memory.put("present_input_voltage", 120)
        image = ServoImage(memory.table, bytes(memory.image[: memory.table["present_temperature"].end]))
        assert complaints(servo, bus, image, needed_ticks(load_uncalibrated("op3").joint_map)[servo.joint]) == []
    torque = lab.memory(1).table["torque_enable"].address
    writes = [data for data in lab.sent if data[7:8] == bytes([Instruction.WRITE])]
    assert writes and not [data for data in writes if data[8] == torque]


@pytest.mark.parametrize(
    ("joints", "facts"),
    [
        ((), ()),
        (("r_sho_pitch", "l_sho_pitch"), ("r_sho_pitch",)),
        (("r_sho_pitch", "l_el"), ("id 1", "id 7", 2)),
        (("head_pan",), ("r_sho_pitch", "XL430-W250", "XM430-W350")),
    ],
    ids=["none", "one id twice", "several", "model"],
)
def test_none_several_or_another_model_is_refused_and_tried_again(
    joints: Sequence[str],
    facts: tuple[str | int, ...],
    lab: ServoLab,
    connected: list[Sequence[str]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def changed() -> None:
        _put(lab, JOINTS.index("head_pan"), model_number=XL430)
        _put(lab, JOINTS.index("l_el"), id=7)

    _begins_with(monkeypatch, changed)
    connected.append(joints)
    code, out, _ = lab.run("setup", *ROBOT, typed="\n\n")
    assert code == 2  # the input ends at the second servo
    refused, written = (next(line for line in out.splitlines() if word in line) for word in ("not set up", "written"))
    assert out.index(refused) < out.index(written)
    shows(refused, facts)
    assert lab.line.devices[0].baud == 2_000_000 and lab.line.devices[1].baud == 57_600


def test_it_goes_on_where_it_ended_and_leaves_out_what_is_set_up(
    lab: ServoLab, connected: list[Sequence[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    def tuned() -> None:
        for column in (0, 1):
            _put(lab, column, id=column + 1, baud_rate=4, return_delay_time=0)

    _begins_with(monkeypatch, tuned)
    connected.append(("r_sho_pitch", "l_sho_pitch", "r_sho_roll"))
    _, out, _ = lab.run("setup", *ROBOT, typed="r_sho_roll\n\n")
    assert "id: 1 -> 3" in out
    shows(_line(out, "already"), "l_sho_pitch")
    shows(out.splitlines()[-1], "3 of 20", "l_sho_roll")
    assert [device.id for device in lab.line.devices[:4]] == [1, 2, 3, 1]


@pytest.mark.parametrize(("answer", "yes", "device"), [("\n", (), 1), ("y\n", (), 2), ("", ("--yes",), 1)])
def test_a_servo_of_another_joint_is_changed_only_when_that_is_agreed_to(
    answer: str, yes: Sequence[str], device: int, lab: ServoLab, connected: list[Sequence[str]]
) -> None:
    connected += [("r_sho_pitch",), ("r_sho_pitch",)]
    _, out, _ = lab.run("setup", *ROBOT, *yes, typed="\n\n" + answer)
    shows(out.splitlines()[-3] if yes else _line(out, "[y/N]"), "r_sho_pitch")
    assert lab.line.devices[0].id == device
    assert ("left: l_sho_pitch" if device == 1 else "left: r_sho_pitch, r_sho_roll") in out


@pytest.mark.parametrize(("word", "text"), [("2\n", "id: 2 -> 4"), ("\n", "0 of 30")])
def test_of_two_servos_in_one_case_the_operator_says_which(
    word: str, text: str, lab: ServoLab, connected: list[Sequence[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    case = ("left_hip_pitch", "left_hip_roll")
    joints = [servo.joint for servo in load_uncalibrated("toddlerbot").joint_map.servos]
    _begins_with(monkeypatch, lambda: _put(lab, joints.index(case[0]), id=2))
    connected.append(case)
    typed = f"{case[0]}\n\n{word}"
    _, out, _ = lab.run("setup", "--robot", "toddlerbot", "--all", "--port", "emulator", typed=typed)
    shows(_line(out, "which"), 1, 2, "left_hip_pitch")
    assert text in out


def test_words_at_the_question_go_elsewhere(lab: ServoLab) -> None:
    _, out, _ = lab.run("setup", *ROBOT, typed="s\nhead_tlt\nhead_tilt\n\n")
    shows(_line(out, "head_tlt"), "head_tilt")
    assert [device.id for device in lab.line.devices[:20]] == [*[1] * 19, 20]
    shows(out.splitlines()[-1], "1 of 20")


def test_a_dry_run_writes_nothing(lab: ServoLab) -> None:
    code, out, _ = lab.run("setup", *ROBOT, "--dry-run", typed="\n" * 20)
    assert code == 0 and out.count("dry run: nothing was written") == 20
    assert Instruction.WRITE not in lab.instructions() and "0 of 20" in out


def test_power_that_is_off_is_switched_on_when_that_is_agreed_to(
    lab: ServoLab, monkeypatch: pytest.MonkeyPatch
) -> None:
    _begins_with(monkeypatch, lambda: lab.line.devices[-1].write(24, bytes([0]), 0.0))
    _, out, _ = lab.run("setup", *ROBOT, typed="\nn\n")
    shows(_line(out, "[Y/n]"), 200)
    assert out.count("is set up: write") == 0
    _, out, _ = lab.run("setup", *ROBOT, typed="\ny\n\n")
    assert out.count("[Y/n]") == 1 and out.count("is set up: write") == 2


def test_ctrl_c_says_what_is_set_up(lab: ServoLab, monkeypatch: pytest.MonkeyPatch) -> None:
    answers = chain(["", ""], iter(lambda: signal.raise_signal(signal.SIGINT), ""))
    monkeypatch.setattr("builtins.input", lambda question: next(answers))
    code, out, err = lab.run("setup", *ROBOT)
    assert (code, err) == (130, "interrupted\n")
    shows(out.splitlines()[-1], "2 of 20")


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--all",), "the servos of which robot"),
        ((*ROBOT, "--joint", "l_el"), "only one servo can have this"),
        ((*ROBOT, "--new-id", "3"), "only one servo can have this"),
        ((*ROBOT, "--register", "drive_mode=300"), "found 300"),
        (("--robot", "op3", "--all", "--port", "/dev/none", "--yes"), "the input has ended"),
        (("--robot", "op3", "--all"), "--port emulator"),
    ],
)
def test_what_goes_for_no_walk_is_refused(words: tuple[str, ...], text: str, lab: ServoLab) -> None:
    code, _, err = lab.run("setup", *words)
    assert code == 2 and text in err
    shows(err)


# The port.


class Desk:
    """The ports of a machine while the operator answers: one set of them for each look."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, looks: Sequence[str]) -> None:
        self._looks = [look.split() for look in looks]
        monkeypatch.setattr(find_port, "existing_ports", self._look)
        monkeypatch.setattr(find_port, "stable_name", lambda path: f"/dev/serial/by-id/{path}")
        monkeypatch.setattr("builtins.input", self._asked)

    def _asked(self, question: str) -> str:
        echo(question)
        return ""

    def _look(self) -> dict[str, str]:
        return dict.fromkeys(self._looks.pop(0), "an adapter")


@pytest.mark.parametrize(
    ("looks", "said"),
    [
        (["ACM0 USB0", "ACM0", "ACM0 USB0"], "USB0 went away"),
        (["USB0", "USB0", "USB0", "", "", "USB0"], "no port went away"),
        (["ACM0 USB0", "", "ACM0 USB0", "ACM0", "ACM0", "ACM0 USB0"], "2 ports went away: ACM0, USB0"),
        (["USB0", "", "USB0 USB1", "ACM0 USB0", "ACM0", "USB0 ACM0"], "2 ports came: USB0, USB1"),
        (["", "USB0", "", "USB0"], "Plug the adapter in"),
    ],
)
def test_the_port_is_the_one_that_goes_when_the_adapter_is_unplugged(
    looks: list[str], said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    Desk(monkeypatch, looks)
    assert unplugged_port() == "/dev/serial/by-id/USB0"
    shows(capsys.readouterr().out, said)


def test_an_adapter_that_comes_back_by_another_name_is_found_by_it(monkeypatch: pytest.MonkeyPatch) -> None:
    Desk(monkeypatch, ["ACM0 USB0", "ACM0", "ACM0 USB1"])
    assert unplugged_port() == "/dev/serial/by-id/USB1"


def test_the_port_of_the_profile_is_taken_where_it_exists_and_is_agreed_to(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    Desk(monkeypatch, ["USB0", "", "USB0"])
    there, gone = (BusSpec("main", port, 1_000_000, 2, (1,)) for port in ("/dev/null", "/dev/none"))
    assert port_of_bus(there, yes=False) == "/dev/null"
    assert port_of_bus(gone, yes=False) == "/dev/serial/by-id/USB0"
    shows(capsys.readouterr().out, "/dev/none", "does not exist", "the port is /dev/serial/by-id/USB0")
    with refuses(Exception):
        port_of_bus(gone, yes=True)


def test_commands_without_a_port_name_those_that_exist(lab: ServoLab, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(places, "existing_ports", lambda: {"/dev/ttyUSB0": "U2D2", "/dev/ttyS0": ""})
    code, _, err = lab.run("scan")
    assert code == 2
    shows(err, "found /dev/ttyUSB0 (U2D2), /dev/ttyS0")
