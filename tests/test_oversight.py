"""Who may stop a live run, and how it is scheduled: what cannot be had is refused before anything is opened."""

import socket
from pathlib import Path

import pytest

from hardware.errors import HardwareError
from hardware.realtime import Scheduling
from retarget.cli import main
from retarget.cli.oversight import Oversight, refuse_oversight
from retarget.errors import UsageError
from support.messages import refuses, shows


def test_what_can_be_had_is_not_refused(tmp_path: Path) -> None:
    refuse_oversight(Oversight(stop_file=tmp_path / "stop"), virtual=True)
    refuse_oversight(Oversight(dead_man="b"), virtual=False)


def test_what_cannot_be_had_is_refused(tmp_path: Path) -> None:
    with refuses(UsageError, "--stop-file"):
        refuse_oversight(Oversight(stop_file=tmp_path), virtual=False)
    for file in (tmp_path / "gone" / "stop", Path("a\0b")):
        with refuses(UsageError, "--stop-file"):
            refuse_oversight(Oversight(stop_file=file), virtual=False)
    with refuses(UsageError):
        refuse_oversight(Oversight(dead_man="b"), virtual=True)
    with refuses(HardwareError, "--core"):
        refuse_oversight(Oversight(scheduling=Scheduling(core=4096)), virtual=False)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--realtime 0", "--realtime: no such real-time priority; found 0; allowed: 1 to 99"),
        ("--core 4096", "--core: this core cannot be had; found 4096"),
        ("--dead-man b", "--dead-man: there is no terminal on which a key could be held"),
        ("--dead-man pedal:/nowhere/event9", "/nowhere/event9: the device cannot be opened"),
        ("--control-socket /nowhere/x", "--control-socket /nowhere/x: cannot listen: No such file"),
        ("--source walk.bvh --realtime", "--realtime: only a live stream has this"),
        (
            "--source walk.bvh --dead-man b --control-socket",
            "--dead-man, --control-socket: only a live stream has this",
        ),
    ],
)
def test_on_the_command_line_too(words: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["run", "--robot", "human", "--source", "json://:14150", *words.split()])
    assert ended.value.code == 2 and said in capsys.readouterr().err


def test_a_port_that_is_taken_is_refused_with_its_holder(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        port = holder.getsockname()[1]
        with pytest.raises(SystemExit) as ended:
            main(["run", "--robot", "human", "--source", f"json://:{port}"])
    said = capsys.readouterr().err
    assert ended.value.code == 2
    shows(said, "UDP", port)
