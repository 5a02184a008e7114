"""A pedal by its events, through a pipe in place of the device."""

import os
import random
from collections.abc import Iterator
from pathlib import Path

import pytest

from hardware.errors import HardwareError
from hardware.key_device import EVENT, KeyDevice
from messages import refuses

KEY_B, BTN_TRIGGER = 48, 0x120


class Pedal:
    """A pipe at which a pedal is pressed."""

    def __init__(self, path: Path) -> None:
        self.path = str(path)
        os.mkfifo(path)
        self.fd = os.open(path, os.O_RDWR | os.O_NONBLOCK)

    def event(self, kind: int, code: int, value: int) -> None:
        os.write(self.fd, EVENT.pack(1, 2, kind, code, value) + EVENT.pack(1, 2, 0, 0, 0))

    def unplug(self) -> None:
        if self.fd >= 0:
            os.close(self.fd)
        self.fd = -1


@pytest.fixture
def pedal(tmp_path: Path) -> Iterator[Pedal]:
    made = Pedal(tmp_path / "event7")
    yield made
    made.unplug()


def test_it_is_pressed_until_it_is_let_go(pedal: Pedal) -> None:
    device = KeyDevice(pedal.path)
    assert not device.pressed()
    pedal.event(1, KEY_B, 1)
    assert device.pressed() and device.pressed()
    pedal.event(1, KEY_B, 2)
    assert device.pressed()
    pedal.event(1, KEY_B, 0)
    assert not device.pressed() and not device.lost
    device.close()
    device.close()


def test_a_repeat_of_what_was_down_before_is_no_press(pedal: Pedal) -> None:
    device = KeyDevice(pedal.path)
    pedal.event(1, KEY_B, 2)
    assert not device.pressed()


def test_only_the_chosen_key_counts(pedal: Pedal) -> None:
    device = KeyDevice(pedal.path, code=BTN_TRIGGER)
    pedal.event(1, KEY_B, 1)
    assert not device.pressed()
    pedal.event(1, BTN_TRIGGER, 1)
    assert device.pressed()
    pedal.event(1, KEY_B, 0)
    assert device.pressed()


def test_events_that_the_kernel_dropped_let_go(pedal: Pedal) -> None:
    device = KeyDevice(pedal.path)
    pedal.event(1, KEY_B, 1)
    assert device.pressed()
    pedal.event(0, 3, 0)
    assert not device.pressed()


def test_an_event_may_come_in_pieces(pedal: Pedal) -> None:
    device, event = KeyDevice(pedal.path), EVENT.pack(1, 2, 1, KEY_B, 1)
    os.write(pedal.fd, event[:7])
    assert not device.pressed()
    os.write(pedal.fd, event[7:])
    assert device.pressed()


def test_unplugged_is_let_go(pedal: Pedal) -> None:
    device = KeyDevice(pedal.path)
    pedal.event(1, KEY_B, 1)
    assert device.pressed()
    pedal.unplug()
    assert not device.pressed() and device.lost
    assert not device.pressed()


def test_whatever_bytes_come_nothing_raises_and_a_release_releases(pedal: Pedal) -> None:
    device, chance = KeyDevice(pedal.path), random.Random(3)
    for _ in range(500):
        os.write(pedal.fd, chance.randbytes(chance.randrange(1, 200)))
        device.pressed()
    os.write(pedal.fd, bytes(-len(device._rest) % EVENT.size))
    device.pressed()
    assert all(code <= 0x2FF for code in device._down)
    for code in sorted(device._down):
        pedal.event(1, code, 0)
    for _ in range(100):
        device.pressed()
    assert not device.pressed()


def test_what_is_no_device_is_refused(tmp_path: Path) -> None:
    with refuses(HardwareError, "event9"):
        KeyDevice(str(tmp_path / "event9"))
    (tmp_path / "file").write_bytes(b"")
    for path in (str(tmp_path / "file"), "/dev/null"):
        with refuses(HardwareError):
            KeyDevice(path)
    with refuses(HardwareError):
        KeyDevice("a\0b")


def test_without_permission_it_says_what_to_do(pedal: Pedal, monkeypatch: pytest.MonkeyPatch) -> None:
    def forbidden(*_: object) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", forbidden)
    with refuses(HardwareError, "usermod"):
        KeyDevice(pedal.path)
