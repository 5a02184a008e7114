"""A pedal, button or keyboard, read from Linux's event device (evdev): which keys are down, and when they go up."""

import fcntl
import os
import stat
import struct
from contextlib import suppress
from pathlib import Path

from hardware.errors import HardwareError

EVENT = struct.Struct("@llHHi")
"""A `struct input_event` (linux/input.h): two words of time, type, code, value."""
EV_SYN, EV_KEY = 0, 1
SYN_DROPPED = 3
UP, DOWN = 0, 1
"""Values of EV_KEY; 2 is a repeat, which is ignored."""
MOST_CODE = 0x2FF
"""KEY_MAX."""
EVIOCGVERSION = 0x80044501
"""Request that only an event device answers."""
MOST_EVENTS, MOST_READS = 64, 8
"""Bounds of what one call reads."""
BY_ID = Path("/dev/input/by-id")


class KeyDevice:
    """An open event device. Pressed means pressed since it was opened: a key that is down before counts from its next
    press.

    code: the only key that counts, as `evtest` shows it; None: any. lost: why the device sends no more events, ""
    while it does. Never waits, never raises once it is open.
    """

    def __init__(self, path: str, *, code: int | None = None) -> None:
        """Raises HardwareError: no such device, not for this user, or no event device."""
        self.path, self._code, self.lost = path, code, ""
        self._down: set[int] = set()
        self._rest = b""
        self._fd: int | None = _opened(path)

    def close(self) -> None:
        """Close it; twice does no harm."""
        fd, self._fd = self._fd, None
        self._down.clear()
        if fd is not None:
            with suppress(OSError):
                os.close(fd)

    def pressed(self) -> bool:
        """Whether a key that counts is down now; never, once the device is lost."""
        for _ in range(MOST_READS):
            data = self._read()
            if not data:
                break
            self._take(data)
        return bool(self._down)

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

    def _take(self, data: bytes) -> None:
        data = self._rest + data
        whole = len(data) - len(data) % EVENT.size
        self._rest = data[whole:]
        for _, _, kind, code, value in EVENT.iter_unpack(data[:whole]):
            if kind == EV_SYN and code == SYN_DROPPED:  # a release may be among what the kernel dropped
                self._down.clear()
            elif kind == EV_KEY and code <= MOST_CODE and self._code in (None, code):
                if value == DOWN:
                    self._down.add(code)
                elif value == UP:
                    self._down.discard(code)


def _opened(path: str) -> int:
    try:
        fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except PermissionError as error:
        step = "Join the group of such devices: sudo usermod -aG input $USER, then log in again"
        raise _refused(path, "this device is not for this user", step) from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise _refused(path, f"the device cannot be opened: {reason}", _which()) from error
    try:
        mode = os.fstat(fd).st_mode
        if not stat.S_ISFIFO(mode):
            fcntl.ioctl(fd, EVIOCGVERSION, b"\0" * 4)
    except OSError as error:
        os.close(fd)
        raise _refused(path, "this is no event device", _which()) from error
    return fd


def _which() -> str:
    with suppress(OSError):
        names = sorted(str(entry) for entry in BY_ID.iterdir() if entry.name.endswith(("-kbd", "-joystick")))
        if names:
            return f"Plugged in are: {', '.join(names[:10])}"
    return "Plug it in, and see which it is: ls /dev/input/by-id, or sudo evtest"


def _refused(path: str, what: str, then: str) -> HardwareError:
    return HardwareError(what, where=path, then=then)
