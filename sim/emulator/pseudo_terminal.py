"""A line of emulated devices behind a pseudo-terminal: any program that opens a serial port can talk to it (Linux)."""

import array
import contextlib
import fcntl
import os
import termios
import tty

from hardware.errors import HardwareError, describe
from sim.emulator.line import Line
from sim.emulator.link import Link

CHUNK = 4096
"""Most bytes that are read at once; the kernel keeps no more."""
_TCGETS2, _SPEED_WORD = 0x802C542A, 10
"""Linux's ioctl that tells the real speed a client has set, and where in the answer."""


class PseudoTerminal:
    """One line and its link. `hear` when its `fd` has bytes, `speak` when some are due, `follow` when a fault may have
    pulled or put back the plug: then a new pseudo-terminal is behind the same link."""

    def __init__(self, line: Line, link: Link) -> None:
        self.line, self.link = line, link
        self.fd = -1
        """What to wait on; -1 while unplugged."""
        self.path = ""
        """The pseudo-terminal itself."""
        self.lost = 0
        """Bytes that the kernel did not take: nobody reads."""
        self._client = -1
        self._speed = array.array("I", bytes(44))

    def open(self) -> None:
        """Make the pseudo-terminal and let the link lead to it. Raises UsageError, HardwareError."""
        self.link.check()
        try:
            master, client = os.openpty()
        except OSError as error:
            raise HardwareError(
                describe(what=f"no pseudo-terminal is to be had: {error.strerror}", where=str(self.link.path))
            ) from None
        # The client's side stays open here as well: else a client that closes it would hang up the line.
        self.fd, self._client = master, client
        try:
            tty.setraw(client, termios.TCSANOW)
            os.set_blocking(master, False)
            self.path = os.ttyname(client)
            self.link.point(self.path)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Hang up, and take the link away."""
        self._hang_up()
        self.link.remove()

    def hear(self, now: float) -> None:
        """Hand what the client has written to the line, at the client's speed."""
        try:
            data = os.read(self.fd, CHUNK)
        except (BlockingIOError, InterruptedError):
            return
        self.line.baud = self._baud()
        self.line.hear(data, now)

    def speak(self, now: float) -> None:
        """Give the client what has arrived by `now`. What it does not take is lost, as in a real adapter."""
        data = self.line.take(now)
        if data:
            sent = 0
            with contextlib.suppress(BlockingIOError):
                sent = os.write(self.fd, data)
            self.lost += len(data) - sent

    def follow(self, now: float) -> None:
        """Hang up while the line is unplugged, be there again when it is back. The link stays this emulator's.

        Raises UsageError for a lost link.
        """
        gone = self.line.unplugged(now)
        if gone and self.fd >= 0:
            self._hang_up()
        elif not gone and self.fd < 0:
            self.open()

    def _hang_up(self) -> None:
        self.link.hide()
        for fd in (self._client, self.fd):
            if fd >= 0:
                os.close(fd)
        self.fd = self._client = -1

    def _baud(self) -> int:
        """The client's speed. Also undoes a lock that a client has set and, since this side stays open, would outlive
        it."""
        fcntl.ioctl(self._client, termios.TIOCNXCL)
        fcntl.ioctl(self._client, _TCGETS2, self._speed)
        return self._speed[_SPEED_WORD] or 1
