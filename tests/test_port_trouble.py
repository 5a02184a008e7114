"""Errors of ports in words."""

import errno
import os
from pathlib import Path

import pytest

from hardware.dynamixel import port_trouble


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
    assert "no such baud rate; found 4500000" in str(error)


def test_who_holds_a_port(tmp_path: Path) -> None:
    device, other = tmp_path / "tty", tmp_path / "other"
    device.touch()
    other.touch()
    processes = tmp_path / "proc"
    for number, held in [("12", device), ("13", other), ("14", device)]:
        (processes / number / "fd").mkdir(parents=True)
        (processes / number / "fd" / "3").symlink_to(held)
        (processes / number / "comm").write_text(f"name{number}\n")
    (processes / "15").mkdir()
    found = port_trouble.holders(str(device), processes)
    assert 'process 12 ("name12")' in found
    assert 'process 14 ("name14")' in found
    assert "13" not in found
    assert port_trouble.holders(str(tmp_path / "none"), processes) == "another process"


def test_who_may_use_a_port_is_told() -> None:
    error = port_trouble.why_not_open(os.devnull, 57_600, PermissionError(errno.EACCES, "no"))
    assert "group" in str(error)
    error = port_trouble.why_not_open("/dev/none", 57_600, PermissionError(errno.EACCES, "no"))
    assert "no rights" in str(error)
