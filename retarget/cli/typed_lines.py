"""Lines that somebody types, or another program writes, while a command waits for other things too."""

import os
import stat
import sys
from collections.abc import Callable

__all__ = ["TypedLines"]

MAX_LINE = 4096
"""Longest line that is kept, bytes; a longer one is cut there."""


class TypedLines:
    """Whole lines of the standard input, handed to `obey` as they come. Only a terminal in front, or a pipe, is read:
    a process in the background would be stopped by reading."""

    def __init__(self, obey: Callable[[str], None]) -> None:
        self._obey = obey
        self._pending = b""

    @staticmethod
    def descriptor() -> int | None:
        """What to wait on; None where nobody can type."""
        try:
            fd = sys.stdin.fileno()
            mode = os.fstat(fd).st_mode
        except (AttributeError, OSError, ValueError):
            return None
        return fd if stat.S_ISFIFO(mode) or _in_front(fd) else None

    def read(self) -> bool:
        """Take what is there; False at the end of the input."""
        fd = self.descriptor()
        try:
            data = b"" if fd is None else os.read(fd, MAX_LINE)
        except OSError:
            return False
        *lines, rest = (self._pending + data).split(b"\n")
        self._pending = rest[:MAX_LINE]
        if not data and rest:
            lines, self._pending = [rest], b""
        for line in lines:
            self._obey(line.decode(errors="replace"))
        return bool(data)


def _in_front(fd: int) -> bool:
    """Whether it is a terminal, and this process stands in front of it."""
    try:
        return os.isatty(fd) and os.tcgetpgrp(fd) == os.getpgrp()
    except OSError:
        return False
