"""Errors of ports in words."""

import errno
import os
from pathlib import Path

import pytest

from hardware.dynamixel import port_trouble
from support.messages import shows


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.ENOENT, "no such port"),
        (errno.ENXIO, "no such port"),
        (errno.EIO, "no such port"),
        (errno.EBUSY, "busy"),
        (errno.EAGAIN, "busy"),
        (errno.EACCES, "dialout"),
        (errno.EPERM, "dialout"),
        (errno.ENOTTY, "not a serial port"),
    ],
)
def test_a_number_becomes_words(number: int, words: str) -> None:
    error = port_trouble.why_not_open("/dev/ttyUSB0", 57_600, OSError(number, os.strerror(number)))
    assert words in str(error)
    assert "/dev/ttyUSB0" in str(error)


def test_a_speed_that_the_driver_refuses() -> None:
    error = port_trouble.why_not_open(os.devnull, 4_500_000, ValueError("custom baud rate"))
    shows(str(error), 4500000)


def _process(folder: Path, number: int, command: str, *held: Path) -> None:
    process = folder / str(number)
    for name in ("fd", "fdinfo"):
        (process / name).mkdir(parents=True)
    for at, target in enumerate(held):
        (process / "fd" / str(at)).symlink_to(target)
        (process / "fdinfo" / str(at)).write_text("pos:\t0\ntty-index:\t71\n" if target.name == "ptmx" else "pos:\t0\n")
    (process / "cmdline").write_text(command.replace(" ", "\0") + "\0")


def test_who_holds_a_port_is_told_with_its_command_line(tmp_path: Path) -> None:
    device, other = tmp_path / "tty", tmp_path / "other"
    device.touch()
    other.touch()
    processes = tmp_path / "proc"
    _process(processes, 12, "bin/python bin/retarget servo monitor --robot op3", device)
    _process(processes, 13, "retarget run", other)
    _process(processes, 14, "screen tty", other, device)
    (processes / "15").mkdir()
    found = port_trouble.holders(str(device), processes)
    assert sorted(found.split(", ")) == ["process 12 (retarget servo monitor --robot op3)", "process 14 (screen tty)"]
    assert port_trouble.holders(str(tmp_path / "none"), processes) == "another process"


@pytest.mark.parametrize(
    ("command", "told"),
    [
        ("retarget emulate --link port", "process 11 (retarget emulate --link port) is the emulator"),
        ("socat pty", "process 11 (socat pty) is its other end"),
    ],
)
def test_what_is_behind_a_pseudo_terminal_is_not_what_holds_it(tmp_path: Path, command: str, told: str) -> None:
    device, processes = Path("/dev/pts/71"), tmp_path / "proc"
    _process(processes, 11, command, Path("/dev/ptmx"), device)
    assert port_trouble.holders(str(device), processes) == f"another process; {told}"
    _process(processes, 12, "retarget servo monitor", Path("/dev/null"), device)
    _process(processes, 13, "sshd", Path("/dev/pts/ptmx"), Path("/dev/pts/72"))
    (processes / "13" / "fdinfo" / "0").write_text("tty-index:\t7\n")
    assert port_trouble.holders(str(device), processes) == f"process 12 (retarget servo monitor); {told}"


def test_a_real_pseudo_terminal_knows_its_other_end() -> None:
    master, client = os.openpty()
    try:
        told = port_trouble.holders(os.ttyname(client))
    finally:
        os.close(client)
        os.close(master)
    assert told.startswith(f"another process; process {os.getpid()} (") and told.endswith(") is its other end")


def test_who_may_use_a_port_is_told() -> None:
    error = port_trouble.why_not_open(os.devnull, 57_600, PermissionError(errno.EACCES, "no"))
    shows(str(error))
    error = port_trouble.why_not_open("/dev/none", 57_600, PermissionError(errno.EACCES, "no"))
    shows(str(error))
