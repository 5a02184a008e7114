"""`retarget emulate`: serves until it is stopped, takes typed faults, is refused in one message when it cannot run."""

import importlib
import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import pytest
import yaml
from serial import Serial

from command_line import Typed, copy_of_op3
from hardware.clock import MonotonicClock
from hardware.dynamixel.codec import protocol2
from messages import shows
from retarget.cli.exit import DONE
from sim.emulator.conversation import Conduct, Gaps
from sim.emulator.line import Line
from sim.emulator.servo2_registers import FedBy


def said_on(stream: IO[bytes] | None, seconds: float = 10.0) -> str:
    assert stream is not None and select.select([stream], [], [], seconds)[0], "it says nothing"
    return os.read(stream.fileno(), 4096).decode()


@contextmanager
def emulating(link: Path, *words: str) -> Iterator[tuple["subprocess.Popen[bytes]", str, Typed]]:
    """A process, what it says first, and a function that types a line and returns what is said to it."""
    command = [sys.executable, "-m", "retarget", "emulate", "--robot", "op3", "--link", str(link), *words]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    def typed(line: str) -> str:
        assert process.stdin is not None
        process.stdin.write(f"{line}\n".encode())
        process.stdin.flush()
        return said_on(process.stderr)

    try:
        yield process, said_on(process.stdout, 60.0), typed
    finally:
        process.kill()
        process.communicate()


def test_a_client_is_served_faults_are_typed_and_a_signal_ends_it(tmp_path: Path) -> None:
    link = tmp_path / "op3"
    with emulating(link, "--no-wire-delay") as (process, said, typed):
        assert said == f"op3, bus main: 21 devices answer on {link} (protocol 2.0, 2000000 baud). Ctrl-C ends it.\n"
        with Serial(str(link), 2_000_000, timeout=2.0) as client:
            client.write(protocol2.ping(5))
            answer = client.read(14)
            assert answer.startswith(protocol2.HEADER + b"\x05")
            client.write(protocol2.ping(200))
            assert len(client.read(14)) == 14
            assert typed("missing 5") == "missing 5: begun\n"
            client.timeout = 0.1
            client.write(protocol2.ping(5))
            assert client.read(14) == b""
            shows(typed("clear"))
            client.timeout = 2.0
            client.write(protocol2.ping(5))
            assert client.read(14) == answer
        process.send_signal(signal.SIGTERM)
        assert process.wait(10.0) == DONE
        assert not os.path.lexists(link) and process.stderr is not None
        assert [line for line in process.stderr.read().splitlines() if b"this machine is too slow" not in line] == []


def test_new_servos_are_connected_by_name(tmp_path: Path) -> None:
    with emulating(tmp_path / "op3", "--new") as (_, said, typed):
        shows(said.replace(str(tmp_path), ""), 1)
        with Serial(str(tmp_path / "op3"), 57_600, timeout=0.1) as client:
            for line, answer, size in (
                ("connect", "connected: no servo\n", 0),
                ("connect l_kne", "no such joint: l_kne. Did you mean l_knee", 0),
                ("connect l_knee", "connected: l_knee\n", 14),
            ):
                assert answer in typed(line)
                client.timeout = 2.0 if size else 0.1
                client.write(protocol2.ping(1))
                assert len(client.read(14)) == size


@pytest.mark.long
def test_the_link_of_another_emulator_is_refused_and_that_of_a_killed_one_is_not(
    tmp_path: Path, done: Typed, refused: Typed
) -> None:
    link = tmp_path / "op3"
    words = ("emulate", "--robot", "op3", "--link", link, "--for", "0.05")
    with emulating(link):
        before = link.readlink()
        shows(refused(*words), before, varies=str(before))
        assert link.readlink() == before
    assert link.is_symlink()
    link.unlink()
    link.symlink_to("/dev/pts/99999")  # its number may have gone to another terminal by now
    done(*words)
    assert list(tmp_path.iterdir()) == []


def test_it_ends_by_itself_and_leaves_nothing(tmp_path: Path, done: Typed) -> None:
    shows(done("emulate", "--robot", "op3", "--link", tmp_path / "op3", "--for", "0.05", "--seed", "3"))
    assert list(tmp_path.iterdir()) == []


def test_a_bus_each_has_a_link_of_its_name(tmp_path: Path, done: Typed) -> None:
    path, link = copy_of_op3(tmp_path / "two"), tmp_path / "line"
    profile = yaml.safe_load(path.read_text())
    main = profile["buses"]["main"]
    main["ids"].remove(20)
    profile["buses"]["head"] = {**{key: main[key] for key in ("baud", "protocol")}, "port": "/dev/ttyUSB1", "ids": [20]}
    next(servo for servo in profile["servos"].values() if servo["id"] == 20)["bus"] = "head"
    path.write_text(yaml.safe_dump(profile, sort_keys=False, default_flow_style=None))
    said = done("emulate", "--robot", path.parent, "--link", link, "--for", "0.05")
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
    tmp_path: Path, built: list[tuple[Conduct, Line]], options: tuple[str, ...], conduct: Conduct, done: Typed
) -> None:
    done("emulate", "--robot", "op3", "--link", tmp_path / "op3", "--for", "1e-3", *options)
    assert [made[0] for made in built] == [conduct]


@pytest.mark.parametrize(("options", "parts"), [((), 1), (("--gaps", "skip"), 2)])
def test_an_option_reaches_the_wire(
    tmp_path: Path, built: list[tuple[Conduct, Line]], options: tuple[str, ...], parts: int, done: Typed
) -> None:
    done("emulate", "--robot", "op3", "--link", tmp_path / "op3", "--no-wire-delay", "--for", "1e-3", *options)
    ((_, line),) = built
    later = MonotonicClock().now() + 10.0
    line.receive(protocol2.sync_read(64, 1, [1, 77, 2]), later)
    assert line.take(later) == b"".join(protocol2.status(device, 0, b"\0") for device in (1, 2)[:parts])


def test_every_option_is_in_the_help_and_on_the_page(root: Path, done: Typed) -> None:
    page = (root / "docs/emulator.md").read_text(encoding="utf-8")
    options = {word for word in done("emulate", "--help").split() if word.startswith("--")} - {"--help"}
    assert {"--gaps", "--boot", "--watchdog-fed-by"} <= options
    assert [option for option in sorted(options) if option not in page] == []
