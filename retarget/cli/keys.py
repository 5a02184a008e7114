"""Keys that are pressed while a robot moves, one at a time, without Enter; none where there is no terminal."""

import os
import select
import sys
import termios
import tty
from contextlib import suppress
from types import TracebackType
from typing import Self

__all__ = ["Keys"]

MOST = 64
"""Keys that one look takes."""
INPUT_MODES = 0
"""Where they are in what `termios.tcgetattr` returns."""


class Keys:
    """The keyboard of a terminal as a context. Ctrl-C stays a signal; Ctrl-S does not hold up what is shown."""

    def __init__(self, fd: int | None = None) -> None:
        """fd: of a terminal; None: standard input, if it is one."""
        self._fd = sys.stdin.fileno() if fd is None and sys.stdin.isatty() else fd
        self._before: list[object] | None = None

    def __enter__(self) -> Self:
        if self._fd is not None:
            self._before = termios.tcgetattr(self._fd)
            tty.setcbreak(self._fd, termios.TCSANOW)
            as_keys = termios.tcgetattr(self._fd)
            as_keys[INPUT_MODES] &= ~termios.IXON
            termios.tcsetattr(self._fd, termios.TCSANOW, as_keys)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._fd is not None and self._before is not None:
            with suppress(termios.error, OSError):  # the terminal may be gone
                termios.tcsetattr(self._fd, termios.TCSANOW, self._before)  # type: ignore[arg-type]
            self._before = None

    @property
    def listens(self) -> bool:
        """Whether there is a terminal."""
        return self._fd is not None

    def pressed(self) -> str:
        """What was pressed since the last look. Never waits, never raises."""
        if self._fd is None:
            return ""
        try:
            if not select.select((self._fd,), (), (), 0.0)[0]:
                return ""
            data = os.read(self._fd, MOST)
        except OSError:
            data = b""
        if not data:  # the terminal is gone
            self._fd = None
        return data.decode("utf-8", errors="ignore")
