"""The FTDI latency timer, from the kernel's files."""

from pathlib import Path

import pytest
from serial import Serial

from hardware.clock import MonotonicClock
from hardware.dynamixel import latency_timer
from hardware.dynamixel.serial_port import SerialPort


def _adapter(devices: Path, text: str) -> Path:
    folder = devices / "ttyUSB0"
    folder.mkdir()
    (folder / "latency_timer").write_text(text)
    link = devices / "by-id-ftdi"
    link.symlink_to("/dev/ttyUSB0")
    return link


def test_it_is_read_through_links(tmp_path: Path) -> None:
    link = _adapter(tmp_path, "16\n")
    assert latency_timer.latency_timer_ms("/dev/ttyUSB0", tmp_path) == 16
    assert latency_timer.latency_timer_ms(str(link), tmp_path) == 16
    assert latency_timer.timer_command(str(link), tmp_path) == (f"echo 1 | sudo tee {tmp_path}/ttyUSB0/latency_timer")


@pytest.mark.parametrize("text", ["", "many\n"])
def test_other_adapters_have_none(tmp_path: Path, text: str) -> None:
    assert latency_timer.latency_timer_ms("/dev/ttyACM0", tmp_path) is None
    _adapter(tmp_path, text)
    assert latency_timer.latency_timer_ms("/dev/ttyUSB0", tmp_path) is None


def test_what_it_means() -> None:
    assert latency_timer.latency(16) == 0.016
    assert latency_timer.latency(1) == latency_timer.latency(0) == latency_timer.latency(None) == 0.001


def test_the_command_is_told_where_it_helps() -> None:
    port = SerialPort("/dev/ttyUSB0", MonotonicClock())
    for timer, told in [(None, False), (1, False), (16, True)]:
        port.latency_timer_ms = timer
        assert (port.latency_command is not None) == told
        assert port.latency == latency_timer.latency(timer)


@pytest.mark.parametrize("failure", [None, ValueError("no ioctl"), OSError(5, "gone"), NotImplementedError()])
def test_the_kernel_is_asked_first(failure: Exception | None) -> None:
    class Line(Serial):  # type: ignore[misc]  # pyserial has no types
        asked = False

        def set_low_latency_mode(self, wanted: bool) -> None:
            Line.asked = wanted
            if failure is not None:
                raise failure

    assert latency_timer.ask_low_latency(Line()) == (failure is None)
    assert Line.asked
