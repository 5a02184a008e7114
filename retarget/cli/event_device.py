"""Pedals, buttons, keyboards and gamepads, read from Linux's event devices (evdev)."""

import fcntl
import os
import stat
import struct
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from hardware.errors import HardwareError

EVENT = struct.Struct("@llHHi")
"""A `struct input_event` (linux/input.h): two words of time, type, code, value."""
EV_SYN, EV_KEY, EV_ABS = 0, 1, 3
SYN_DROPPED = 3
UP, DOWN = 0, 1
"""Values of EV_KEY; 2 is a repeat, which is ignored."""
MOST_CODE = 0x2FF
"""KEY_MAX."""
EVIOCGVERSION = 0x80044501
"""Request that only an event device answers."""
EVIOCGABS = 0x80184540
"""Request for the `struct input_absinfo` of axis 0; that of another axis is higher by its code."""
ABS_INFO = struct.Struct("@6i")
"""Its value, minimum, maximum, fuzz, flat and resolution."""
MOST_EVENTS, MOST_READS = 64, 8
"""Bounds of what one call reads."""
BY_ID = Path("/dev/input/by-id")


class EventDevice:
    """An open event device. lost: why it sends no more events, "" while it does."""

    def __init__(self, path: str) -> None:
        """Raises HardwareError: no such device, not for this user, or no event device."""
        self.path, self.lost = path, ""
        self._down = set[int]()
        self._rest = b""
        self._fd: int | None = _opened(path)

    def close(self) -> None:
        """Close it; twice does no harm. No key is down any more."""
        fd, self._fd = self._fd, None
        self._down.clear()
        if fd is not None:
            with suppress(OSError):
                os.close(fd)

    def axis(self, code: int) -> tuple[int, int]:
        """Least and greatest value of an axis; (0, 0) if there is none."""
        info = bytearray(ABS_INFO.size)
        if self._fd is not None:
            with suppress(OSError):
                fcntl.ioctl(self._fd, EVIOCGABS + code, info)
        _, least, greatest, *_ = ABS_INFO.unpack(info)
        return least, greatest

    def _events(self) -> Iterator[tuple[int, int, int]]:
        """Type, code and value of each event since the last call. Keeps which keys are down: those that were pressed
        since it was opened, and since the kernel last dropped events, for a release may be among those."""
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
