"""Event devices of Linux, and the sticks of a robot that walks: keys, and a gamepad."""

import fcntl
import os
import stat
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from math import copysign, hypot, inf
from pathlib import Path
from typing import Protocol

from hardware.errors import HardwareError
from retarget.robot.walking.pattern import Request

Shares = tuple[float, float, float]
"""Velocity forward, to the left, and turning to the left: shares, -1 to 1, of the robot's fastest walk."""
STAND: Shares = (0.0, 0.0, 0.0)  # no walk


class Stick(Protocol):
    """A control by which the operator requests a velocity."""

    def shares(self, now: float) -> Shares:
        """The requested shares at `now`, s; STAND while nothing is held. Never waits, and raises nothing that a person
        or a device causes."""


DEAD_ZONE = 0.15
"""Shares below count as zero, because worn sticks do not return to the centre."""


def velocity_of(shares: Shares, fastest: Request) -> Request:
    """The velocity of shares of a robot's fastest walk. A diagonal one is no faster than a straight one."""
    forward, left, turn = (copysign(max(abs(share) - DEAD_ZONE, 0.0) / (1.0 - DEAD_ZONE), share) for share in shares)
    length = max(hypot(forward, left), 1.0)
    return Request(fastest.forward * forward / length, fastest.left * left / length, fastest.turn * turn)


# Keys of a terminal, which reports no release of a key.

LAPSE_S = 0.6
"""Time, s, for which a key counts: keyboards wait 0.5 s before they repeat."""
WALK_KEYS: dict[str, Shares] = {  # the shares of each held key are added
    "w": (1.0, 0.0, 0.0),
    "s": (-1.0, 0.0, 0.0),
    "a": (0.0, 1.0, 0.0),
    "d": (0.0, -1.0, 0.0),
    "q": (0.0, 0.0, 1.0),
    "e": (0.0, 0.0, -1.0),
    "x": STAND,
}
KEYS_HELP = "w and s (held) walk forward and back, a and d sideways, q and e turn, x stands"


class KeyStick:
    """Keys that walk while they are held. The last one counts."""

    def __init__(self) -> None:
        self._shares, self._until = STAND, -inf

    def press(self, keys: str, now: float) -> None:
        """Take the keys that came until `now`, s."""
        for key in keys.lower():
            if key in WALK_KEYS:
                self._shares, self._until = WALK_KEYS[key], now + LAPSE_S

    def shares(self, now: float) -> Shares:
        """The shares; see `Stick.shares`."""
        return self._shares if now <= self._until else STAND


# Event devices of Linux (evdev): pedals, buttons, keyboards and gamepads.

EVENT = struct.Struct("@llHHi")
"""`struct input_event` of linux/input.h: two words of time, type, code, value."""
EV_SYN, EV_KEY, EV_ABS = 0, 1, 3
SYN_DROPPED = 3
UP, DOWN = 0, 1
"""Values of EV_KEY. 2 is a repeat."""
MOST_CODE = 0x2FF
"""KEY_MAX."""
EVIOCGVERSION = 0x80044501
"""Request of ioctl that only an event device answers."""
EVIOCGABS = 0x80184540
"""Request for the `struct input_absinfo` of axis 0. Add the code of another axis."""
ABS_INFO = struct.Struct("@6i")
"""`struct input_absinfo`: value, minimum, maximum, fuzz, flat, resolution."""
MOST_EVENTS, MOST_READS = 64, 8
"""Most events a read, and reads a call."""
BY_ID = Path("/dev/input/by-id")


class EventDevice:
    """An open event device. lost: reason why it sends no more events, "" while it does."""

    def __init__(self, path: str) -> None:
        """Raises HardwareError: no such device, no permission, or no event device."""
        self.path, self.lost = path, ""
        self._down = set[int]()
        self._rest = b""
        self._fd: int | None = _opened(path)

    def close(self) -> None:
        """Close it. No key is down any more."""
        fd, self._fd = self._fd, None
        self._down.clear()
        if fd is not None:
            with suppress(OSError):
                os.close(fd)

    def axis(self, code: int) -> tuple[int, int]:
        """Least and greatest value of an axis; (0, 0) without it."""
        info = bytearray(ABS_INFO.size)
        if self._fd is not None:
            with suppress(OSError):
                fcntl.ioctl(self._fd, EVIOCGABS + code, info)
        _, least, greatest, *_ = ABS_INFO.unpack(info)
        return least, greatest

    def _events(self) -> Iterator[tuple[int, int, int]]:
        """Yield type, code and value of each event since the last call, and keep which keys are down. All are up after
        the kernel dropped events, which may have been releases."""
        for _ in range(MOST_READS):
            data = self._read()
            if not data:
                break
            data = self._rest + data
            whole = len(data) - len(data) % EVENT.size
            self._rest = data[whole:]
            for _, _, kind, code, value in EVENT.iter_unpack(data[:whole]):
                if kind == EV_SYN and code == SYN_DROPPED:
                    self._down.clear()
                elif kind == EV_KEY and code <= MOST_CODE:
                    if value == DOWN:
                        self._down.add(code)
                    elif value == UP:
                        self._down.discard(code)
                yield kind, code, value

    def _read(self) -> bytes:
        if self._fd is None:
            return b""
        try:
            data = os.read(self._fd, MOST_EVENTS * EVENT.size)
        except BlockingIOError:
            return b""
        except OSError as error:
            self._lose(error.strerror or str(error))
            return b""
        if not data:
            self._lose("it has ended")
        return data

    def _lose(self, reason: str) -> None:
        self.lost = self.lost or reason
        self.close()


def _opened(path: str) -> int:
    try:
        fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except PermissionError as error:
        step = "Join the group of such devices: sudo usermod -aG input $USER, then log in again"
        raise HardwareError("this device is not for this user", where=path, then=step) from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise HardwareError(f"the device cannot be opened: {reason}", where=path, then=_which()) from error
    try:
        if not stat.S_ISFIFO(os.fstat(fd).st_mode):
            fcntl.ioctl(fd, EVIOCGVERSION, b"\0" * 4)
    except OSError as error:
        os.close(fd)
        raise HardwareError("this is no event device", where=path, then=_which()) from error
    return fd


def _which() -> str:
    with suppress(OSError):
        names = sorted(str(entry) for entry in BY_ID.iterdir() if entry.name.endswith(("-kbd", "-joystick")))
        if names:
            return f"Plugged in are: {', '.join(names[:10])}"
    return "Plug it in, and see which it is: ls /dev/input/by-id, or sudo evtest"


# A gamepad.

GAMEPAD_HELP = "the left stick of the gamepad walks and the right one turns while a shoulder button is held"

ABS_X, ABS_Y, ABS_Z, ABS_RX = 0, 1, 2, 3
"""Axes of the left stick, and to the right of the right one; gamepads without ABS_RX have it as ABS_Z."""
SHOULDERS = {0x136, 0x137, 0x138, 0x139}
"""BTN_TL, BTN_TR, BTN_TL2, BTN_TR2."""


class Gamepad(EventDevice):
    """A gamepad as a stick. Only motion since it was opened counts."""

    def __init__(self, path: str, *, notify: Callable[[str], object]) -> None:
        """notify: receives that the gamepad is lost. Raises HardwareError as an EventDevice does, and for a device
        without two sticks."""
        super().__init__(path)
        self._notify: Callable[[str], object] | None = notify
        codes = (ABS_Y, ABS_X, ABS_RX if any(self.axis(ABS_RX)) else ABS_Z)  # forward, left, turn
        self._ranges = {code: self.axis(code) for code in codes}
        self._shares = dict.fromkeys(codes, 0.0)
        if any(least >= greatest for least, greatest in self._ranges.values()):
            self.close()
            step = "Name the event device of a gamepad: ls /dev/input/by-id/*-event-joystick"
            raise HardwareError("this device has no two sticks", where=path, then=step)

    def shares(self, now: float) -> Shares:
        """The shares; see `Stick.shares`. They count while a shoulder button is down, because a stick that is held
        still sends no events. Once the device is lost the robot stands for good."""
        for kind, code, value in self._events():
            if kind == EV_ABS and code in self._ranges:
                least, greatest = self._ranges[code]  # of an axis that points backward, or to the right
                self._shares[code] = 1.0 - 2.0 * (min(max(value, least), greatest) - least) / (greatest - least)
            elif kind == EV_SYN and code == SYN_DROPPED:
                self._shares = dict.fromkeys(self._shares, 0.0)
        if self.lost and self._notify is not None:
            self._notify(f"{self.path}: {self.lost}: the robot walks no more: stop the run")
            self._notify = None
        if not self._down & SHOULDERS:
            return STAND
        forward, left, turn = self._shares.values()
        return forward, left, turn
