"""`retarget emulate`: serves until it is stopped, takes typed faults, is refused in one message when it cannot run."""

import importlib
import os
import select
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from serial import Serial

from command_line import code_of as leave
from hardware.clock import MonotonicClock
from hardware.dynamixel.codec import protocol2
from messages import shows
from retarget.cli.exit import DONE, REFUSED
from sim.emulator.conversation import Conduct, Gaps
from sim.emulator.line import Line
from sim.emulator.servo2_registers import FedBy

OP3 = Path(__file__).resolve().parent.parent.parent / "configs/robots/op3"


def _line_of(stream: int, seconds: float) -> str:
    assert select.select([stream], [], [], seconds)[0], "it says nothing"
    return os.read(stream, 4096).decode()


def test_a_client_is_served_faults_are_typed_and_a_signal_ends_it(tmp_path: Path) -> None:
    link = tmp_path / "op3"
    command = [sys.executable, "-m", "retarget", "emulate", "--robot", "op3", "--link", str(link), "--no-wire-delay"]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdin and process.stdout and process.stderr
    try:
        said = _line_of(process.stdout.fileno(), 60.0)
        assert said == f"op3, bus main: 21 devices answer on {link} (protocol 2.0, 2000000 baud). Ctrl-C ends it.\n"
        with Serial(str(link), 2_000_000, timeout=2.0) as client:
            client.write(protocol2.ping(5))
            answer = client.read(14)
            assert answer.startswith(protocol2.HEADER + b"\x05")
            client.write(protocol2.ping(200))
            assert len(client.read(14)) == 14
            process.stdin.write(b"missing 5\n")
            process.stdin.flush()
            assert _line_of(process.stderr.fileno(), 10.0) == "missing 5: begun\n"
            client.timeout = 0.1
            client.write(protocol2.ping(5))
            assert client.read(14) == b""
            process.stdin.write(b"clear\n")
            process.stdin.flush()
            shows(_line_of(process.stderr.fileno(), 10.0))
            client.timeout = 2.0
            client.write(protocol2.ping(5))
            assert client.read(14) == answer
        process.send_signal(signal.SIGTERM)
        assert process.wait(10.0) == DONE
        assert not os.path.lexists(link)
        assert [line for line in process.stderr.read().splitlines() if b"this machine is too slow" not in line] == []
    finally:
        process.kill()
        process.communicate()


def test_new_servos_are_connected_by_name(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "retarget", "emulate", "--robot", "op3", "--link", str(tmp_path / "op3"), "--new"]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdin and process.stdout and process.stderr
    try:
        shows(_line_of(process.stdout.fileno(), 60.0).replace(str(tmp_path), ""), 1)
        with Serial(str(tmp_path / "op3"), 57_600, timeout=0.1) as client:
            for typed, said, answers in (
                ("connect", "connected: no servo\n", 0),
                ("connect l_kne", "no such joint: l_kne. Did you mean l_knee", 0),
                ("connect l_knee", "connected: l_knee\n", 14),
            ):
                process.stdin.write(f"{typed}\n".encode())
                process.stdin.flush()
                assert said in _line_of(process.stderr.fileno(), 10.0)
                client.timeout = 2.0 if answers else 0.1
                client.write(protocol2.ping(1))
                assert len(client.read(14)) == answers
    finally:
        process.kill()
        process.communicate()


@pytest.mark.long
def test_the_link_of_another_emulator_is_refused_and_that_of_a_killed_one_is_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    link = tmp_path / "op3"
    words = ("emulate", "--robot", "op3", "--link", str(link))
    process = subprocess.Popen([sys.executable, "-m", "retarget", *words], stdout=subprocess.PIPE)
    assert process.stdout
    try:
        _line_of(process.stdout.fileno(), 60.0)
        before = link.readlink()
        assert leave(*words, "--for", "0.05") == REFUSED
        said = capsys.readouterr().err
        shows(said, before, varies=str(before))
        assert link.readlink() == before
    finally:
        process.kill()
        process.communicate()
    assert link.is_symlink()
    link.unlink()
    link.symlink_to("/dev/pts/99999")  # its number may have gone to another terminal by now
    assert leave(*words, "--for", "0.05") == DONE
    assert list(tmp_path.iterdir()) == []


def test_it_ends_by_itself_and_leaves_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    link = tmp_path / "op3"
    assert leave("emulate", "--robot", "op3", "--link", str(link), "--for", "0.05", "--seed", "3") == DONE
    shows(capsys.readouterr().out)
    assert list(tmp_path.iterdir()) == []


def test_a_bus_each_has_a_link_of_its_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    profile = yaml.safe_load((OP3 / "robot.yaml").read_text())
    main = profile["buses"]["main"]
    main["ids"].remove(20)
    profile["buses"]["head"] = {**{key: main[key] for key in ("baud", "protocol")}, "port": "/dev/ttyUSB1", "ids": [20]}
    next(servo for servo in profile["servos"].values() if servo["id"] == 20)["bus"] = "head"
    robot = tmp_path / "two"
    robot.mkdir()
    (robot / "robot.yaml").write_text(yaml.safe_dump(profile, sort_keys=False, default_flow_style=None))
    (robot / "body.xml").write_bytes((OP3 / "body.xml").read_bytes())
    link = tmp_path / "line"
    assert leave("emulate", "--robot", str(robot), "--link", str(link), "--for", "0.05") == DONE
    said = capsys.readouterr().out
    shows(said, 20, f"{link}-main", "head", 1, f"{link}-head")


@pytest.fixture
def built(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Conduct, Line]]:
    """The conduct given to the servos, and their lines."""
    module = importlib.import_module("retarget.cli.emulate")
    make, made = module.robot_lines, []

    def spy(*args: Any, conduct: Conduct, **more: Any) -> dict[str, Line]:
        lines: dict[str, Line] = make(*args, conduct=conduct, **more)
        made.append((conduct, lines["main"]))
        return lines

    monkeypatch.setattr(module, "robot_lines", spy)
    return made


@pytest.mark.parametrize(
    ("options", "conduct"),
    [
        ((), Conduct()),
        (("--gaps", "silence", "--watchdog-fed-by", "any"), Conduct()),
        (("--gaps", "skip"), Conduct(gaps=Gaps.SKIP)),
        (("--boot", "1.5"), Conduct(boot_time=1.5)),
        (("--boot", "0"), Conduct(boot_time=0.0)),
        (("--watchdog-fed-by", "own"), Conduct(fed_by=FedBy.OWN)),
    ],
)
def test_what_the_manual_leaves_open_is_an_option(
    tmp_path: Path, built: list[tuple[Conduct, Line]], options: tuple[str, ...], conduct: Conduct
) -> None:
    assert leave("emulate", "--robot", "op3", "--link", str(tmp_path / "op3"), "--for", "1e-3", *options) == DONE
    assert [made[0] for made in built] == [conduct]


@pytest.mark.parametrize(("options", "parts"), [((), 1), (("--gaps", "skip"), 2)])
def test_an_option_reaches_the_wire(
    tmp_path: Path, built: list[tuple[Conduct, Line]], options: tuple[str, ...], parts: int
) -> None:
    words = ("--robot", "op3", "--link", str(tmp_path / "op3"), "--no-wire-delay", "--for", "1e-3", *options)
    assert leave("emulate", *words) == DONE
    ((_, line),) = built
    later = MonotonicClock().now() + 10.0
    line.receive(protocol2.sync_read(64, 1, [1, 77, 2]), later)
    assert line.take(later) == b"".join(protocol2.status(device, 0, b"\0") for device in (1, 2)[:parts])


def test_every_option_is_in_the_help_and_on_the_page(capsys: pytest.CaptureFixture[str]) -> None:
    page = (OP3.parents[2] / "docs/emulator.md").read_text(encoding="utf-8")
    assert leave("emulate", "--help") == DONE
    options = {word for word in capsys.readouterr().out.split() if word.startswith("--")} - {"--help"}
    assert {"--gaps", "--boot", "--watchdog-fed-by"} <= options
    assert [option for option in sorted(options) if option not in page] == []
