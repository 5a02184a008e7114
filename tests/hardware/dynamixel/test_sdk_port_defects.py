"""What the ports of dynamixel-sdk 4.1.0 get wrong, shown on the SDK itself, and that ours does it right.

A newer SDK that fixes one of them fails the first half of its test: then our workaround may go.
"""

import os
import tty
from collections.abc import Iterator
from pathlib import Path

import dynamixel_sdk
import pytest
from dynamixel_sdk import (
    COMM_PORT_BUSY,
    COMM_RX_TIMEOUT,
    PortHandler,
    Protocol2PacketHandler,
)

from hardware.clock import MonotonicClock, VirtualClock
from hardware.dynamixel.codec import protocol2
from hardware.dynamixel.control_table import find_table
from hardware.dynamixel.serial_port import QUIET, SerialPort
from hardware.dynamixel.single_requests import OneOff
from hardware.errors import BusError
from messages import refuses
from scripted_port import ScriptedPort, always
from sdk_line import FakeLine, sdk_over

TABLE = find_table("XM430-W350", 2)
GOAL, POSITION = TABLE["goal_position"], TABLE["present_position"]
FOUR = b"\xa6\0\0\0"


@pytest.fixture
def terminal() -> Iterator[str]:
    far, near = os.openpty()
    tty.setraw(far)
    tty.setraw(near)
    yield os.ttyname(near)
    os.close(far)
    os.close(near)


def test_3_the_highest_speeds_are_refused(terminal: str) -> None:
    assert not PortHandler(terminal).setBaudRate(4_500_000)
    port = SerialPort(terminal, MonotonicClock())
    port.open(4_500_000)
    assert port.baud == 4_500_000
    port.close()


def test_4_silence_costs_34_ms(monkeypatch: pytest.MonkeyPatch) -> None:
    port = sdk_over(FakeLine(), monkeypatch)
    assert Protocol2PacketHandler().read4ByteTxRx(port, 1, 132)[1] == COMM_RX_TIMEOUT
    port.setPacketTimeout(15)
    assert port.packet_timeout > 34.0

    ours = ScriptedPort(always())
    with pytest.raises(BusError):
        OneOff(ours, 2, retries=0).read(1, POSITION)
    assert ours.now() < 0.008 + QUIET  # then a late answer may pass, so that it is taken for no other
    begun = ours.now()
    assert OneOff(ours, 2, retries=0).ping(1) is None
    assert ours.now() - begun < 0.008


def test_8_an_exception_blocks_the_port_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    line = FakeLine()
    port = sdk_over(line, monkeypatch)
    line.broken = True
    with refuses(OSError, "Input/output"):
        Protocol2PacketHandler().read4ByteTxRx(port, 1, 132)
    line.broken = False
    assert Protocol2PacketHandler().read4ByteTxRx(port, 1, 132)[1] == COMM_PORT_BUSY

    ours = ScriptedPort(always(protocol2.status(1, 0, FOUR)))
    servo = OneOff(ours, 2)
    ours.broken = True
    with pytest.raises(BusError):
        servo.read(1, POSITION)
    ours.broken = False
    assert servo.read(1, POSITION) == 166


def test_10_stale_bytes_are_dropped_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before 4.0.5 the SDK drained what it sent instead; 4.1.0 is right, and so are we."""
    line = FakeLine(protocol2.status(1, 0, b"\x07\0\0\0"))
    port = sdk_over(line, monkeypatch)
    line.coming = protocol2.status(1, 0, FOUR)
    assert Protocol2PacketHandler().read4ByteTxRx(port, 1, 132)[0] == 7
    assert line.drained == 0

    ours = ScriptedPort(always(protocol2.status(1, 0, b"\x07\0\0\0")))
    ours.feed(protocol2.status(1, 0, FOUR))
    assert OneOff(ours, 2).read(1, POSITION) == 7


def test_11_waiting_is_polling(monkeypatch: pytest.MonkeyPatch) -> None:
    line = FakeLine()
    Protocol2PacketHandler().read4ByteTxRx(sdk_over(line, monkeypatch), 1, 132)
    assert line.reads > 500

    ours = ScriptedPort(always())
    with pytest.raises(BusError):
        OneOff(ours, 2, retries=0).read(1, POSITION)
    assert ours.looks <= 3


def test_12_timeouts_follow_the_wall_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    port = PortHandler("fake")
    port.setPacketTimeoutMillis(50.0)
    monkeypatch.setattr(dynamixel_sdk.port_handler.time, "time", lambda: 4e9)
    assert port.isPacketTimeout()

    assert SerialPort("fake", VirtualClock(3.0)).now() == 3.0
    assert OneOff(ScriptedPort(always(protocol2.status(1, 0, FOUR))), 2).read(1, POSITION) == 166


def test_12_closing_what_never_was_open() -> None:
    with pytest.raises(AttributeError):
        PortHandler("fake").closePort()
    SerialPort("fake", MonotonicClock()).close()


def test_12_two_processes_share_the_bytes(terminal: str) -> None:
    first, second = PortHandler(terminal), PortHandler(terminal)
    assert first.openPort()
    assert second.openPort()
    first.closePort()
    second.closePort()

    ours, late = SerialPort(terminal, MonotonicClock()), SerialPort(terminal, MonotonicClock())
    ours.open(57_600)
    with refuses(BusError):
        late.open(57_600)
    ours.close()


def test_12_a_missing_port_is_no_answer(tmp_path: Path) -> None:
    with refuses(OSError):
        PortHandler(str(tmp_path / "none")).openPort()
    with refuses(BusError):
        SerialPort(str(tmp_path / "none"), MonotonicClock()).open(57_600)
