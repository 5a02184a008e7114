"""Ports to a line of emulated devices: in this process on any clock, or as a pseudo-terminal with a link."""

import array
import fcntl
import math
import os
import re
import select
import termios
import tty
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from hardware.clock import Clock
from hardware.errors import BusError, HardwareError, describe
from retarget.errors import UsageError
from sim.emulator.line import Line, pieces


class EmulatedPort:
    """A `hardware.dynamixel.serial_port.BytePort` on a virtual clock, which several ports may share, or a real one."""

    def __init__(self, line: Line, clock: Clock, *, name: str = "emulator") -> None:
        self._line, self._clock, self.name = line, clock, name
        self._open = False

    @property
    def baud(self) -> int:
        """Baud rate of the host, bits/s."""
        return self._line.baud

    @property
    def latency(self) -> float:
        """Latency of the emulated adapter, s."""
        return self._line.timing.latency

    def open(self, baud: int) -> None:
        """Open it. Raises BusError if it is open."""
        if self._open:
            raise BusError(
                describe(what="the port is busy", where=self.name, then="Close what else uses it, then try again")
            )
        self._open = True
        self.set_baud(baud)

    def set_baud(self, baud: int) -> None:
        """Change the baud rate of the host; the devices keep theirs."""
        self._require("set the baud rate")
        if baud <= 0:
            raise BusError(describe(what="no such baud rate", where=self.name, found=baud, allowed="above 0"))
        self._line.baud = baud
        self.drop()

    def write(self, data: bytes) -> None:
        """Send bytes, which the line receives now."""
        self._require("write")
        if data:
            self._line.receive(data, self._clock.now())

    def read(self) -> bytes:
        """The bytes that have arrived."""
        self._require("read")
        return self._line.take(self._clock.now())

    def wait(self, deadline: float) -> bool:
        """Sleep until bytes have arrived (True) or until `deadline`, s."""
        self._require("wait")
        due = self._line.next_due
        self._clock.sleep_until(deadline if due is None else min(due, deadline))
        self._require("wait")
        return due is not None and due <= self._clock.now()

    def drop(self) -> None:
        """Drop the bytes that have arrived."""
        self._require("drop")
        self._line.take(self._clock.now())

    def now(self) -> float:
        """Time of the clock, s."""
        return self._clock.now()

    def sleep_until(self, deadline: float) -> None:
        """Sleep until `deadline`, s of the clock."""
        self._clock.sleep_until(deadline)

    def close(self) -> None:
        """Close it; twice is allowed."""
        self._open = False

    def _require(self, what: str) -> None:
        if not self._open:
            raise BusError(describe(what=f"cannot {what}: the port is closed", where=self.name, then="Open it first"))
        if self._line.unplugged(self._clock.now()):
            self._open = False
            raise BusError(
                describe(what="there is no such port", where=self.name, then="Check the adapter and its cable")
            )


_TERMINALS = re.compile(r"/dev/pts/\d+")
"""Targets of links."""


class Link:
    """A symlink by which clients find the pseudo-terminal of a line."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._target: str | None = None

    def check(self) -> None:
        """Raise UsageError if no link can be made here: no such folder, or the path is taken. A link to a
        pseudo-terminal that is gone is of an emulator that was killed, and may be replaced."""
        folder, where = self.path.parent, str(self.path)
        if not os.access(folder, os.W_OK | os.X_OK):
            step = "Make the folder, or name one of your own"
            raise UsageError("there is no such folder, or nothing can be made in it", where=where, next_step=step)
        if not os.path.lexists(self.path):
            return
        target = os.readlink(self.path) if self.path.is_symlink() else ""  # noqa: PTH115 - as text, unchanged
        if not _TERMINALS.fullmatch(target) or (Path(target).exists() and target != self._target):
            raise UsageError(
                "the path of the link is taken",
                where=where,
                found="a folder" if self.path.is_dir() else f"a link to {target}" if target else "a file",
                allowed="a path where nothing is, or a link to a pseudo-terminal that is gone",
                next_step="End the emulator that has it, or name another path",
            )

    def point(self, target: str) -> None:
        """Point the link to `target`, in one step. Raises UsageError."""
        self.check()
        try:
            fresh = self.path.with_name(f".{self.path.name}.{os.getpid()}")
            fresh.symlink_to(target)
            fresh.replace(self.path)
        except OSError as error:
            raise UsageError(
                f"the link cannot be made: {error.strerror}", where=str(self.path), next_step="Name another path"
            ) from None
        self._target = target

    def remove(self) -> None:
        """Remove the link if it still has the target of `point`."""
        with suppress(OSError):
            if self._target is not None and os.readlink(self.path) == self._target:  # noqa: PTH115 - as text, unchanged
                self.path.unlink()
        self._target = None


CHUNK = 4096
"""Bytes that are read at once: the buffer of the kernel."""
TOO_LATE = 2e-3
"""A process that is later than this, s, answers later than a real bus, so that a client may send again."""
HOPELESS = 20e-3
"""Longer than any client waits for an answer, s."""
_TCGETS2, _SPEED_WORD = 0x802C542A, 10
"""The ioctl of Linux that reads the baud rate of the client, and its index in the answer."""


class PseudoTerminal:
    """A line behind a pseudo-terminal and its link: any program can open it as a serial port (Linux).

    Call `receive` when `fd` has bytes, `send` when some are due, `follow` when a fault may have unplugged the adapter.
    fd: -1 while unplugged. lost: bytes that the kernel did not take. too_late: greatest delay of an answer since this
    was last 0, s.
    """

    def __init__(self, line: Line, link: Link) -> None:
        self.line, self.link = line, link
        self.fd = -1
        self.path = ""
        self.lost = 0
        self.too_late = 0.0
        self._client = -1
        self._speed = array.array("I", bytes(44))

    def open(self) -> None:
        """Make the pseudo-terminal and its link. Raises UsageError, HardwareError."""
        self.link.check()
        try:
            master, client = os.openpty()
        except OSError as error:
            raise HardwareError(
                describe(what=f"no pseudo-terminal is to be had: {error.strerror}", where=str(self.link.path))
            ) from None
        # The side of the client stays open here, so that a client that closes it does not hang up the line.
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
        """Hang up, and remove the link."""
        self.link.remove()
        for fd in (self._client, self.fd):
            if fd >= 0:
                os.close(fd)
        self.fd = self._client = -1

    def receive(self, now: float, late: float = 0.0) -> None:
        """Pass the bytes of the client to the line, at its baud rate. late: how long they may have waited, s.

        A client that sends again while servos answer collides with them, unless this process is late: then its bytes
        come after the answer, and `too_late` is updated.
        """
        try:
            data = os.read(self.fd, CHUNK)
        except (BlockingIOError, InterruptedError):
            return
        # A lock of a client would outlive it, since this side stays open: it is undone.
        fcntl.ioctl(self._client, termios.TIOCNXCL)
        fcntl.ioctl(self._client, _TCGETS2, self._speed)
        self.line.baud = self._speed[_SPEED_WORD] or 1
        for piece in pieces(data):
            if late > TOO_LATE and now < self.line.servos_free:
                self.too_late = max(self.too_late, late)
                now = self.line.servos_free
            self.line.receive(piece, now)

    def send(self, now: float) -> None:
        """Pass the bytes that are due by `now` to the client. Bytes that it does not take are lost."""
        due = self.line.next_due
        if due is not None and now - due > HOPELESS:
            self.too_late = max(self.too_late, now - due)
        data = self.line.take(now)
        if data:
            sent = 0
            with suppress(BlockingIOError):
                sent = os.write(self.fd, data)
            self.lost += len(data) - sent

    @property
    def next_due(self) -> float:
        """Time of the next send, or begin or end of a fault, s; inf: never."""
        due = self.line.last_due_within(min(BATCH, self.line.timing.latency))
        change = self.line.faults.next_change
        return min(math.inf if due is None else due - EARLY, math.inf if change is None else change)

    def follow(self, now: float) -> None:
        """Hang up while the line is unplugged, and open again afterwards. Raises UsageError if the path was taken."""
        gone = self.line.unplugged(now)
        if gone and self.fd >= 0:
            self.close()
        elif not gone and self.fd < 0:
            self.open()


EARLY = 120e-6
"""Bytes are sent so early, s: a timer is no finer than 50 us, and a pseudo-terminal takes some 70 us."""
BATCH = 0.3e-3
"""Answers within so many s, and within the latency, are passed on together, as an adapter passes on packets."""
LONGEST_SLEEP = 3600.0
"""Longest single sleep, s."""
WARN_AGAIN = 1.0
"""Shortest time between two warnings, s."""


def serve(
    terminals: Sequence[PseudoTerminal],
    clock: Clock,
    *,
    until: Callable[[], bool],
    listen: Mapping[int, Callable[[], bool]] | None = None,
    deadline: float = math.inf,
    warn: Callable[[str], None] = lambda text: None,
) -> None:
    """Serve opened terminals until `until()` or the `deadline`, s on the clock.

    listen: further file descriptors and functions to call when they are readable; one that returns False is not called
    again. warn: receives messages that this machine is too slow, at most every WARN_AGAIN s.
    """
    others = dict(listen or {})
    warned, turned, waited = -math.inf, clock.now(), time_in_queue()
    while not until():
        now = clock.now()
        if now >= deadline:
            return
        for terminal in terminals:
            terminal.follow(now)
        plugged = {terminal.fd: terminal for terminal in terminals if terminal.fd >= 0}
        wake = min(deadline, now + LONGEST_SLEEP, *(terminal.next_due for terminal in terminals))
        busy = clock.now() - turned
        ready, _, _ = select.select([*plugged, *others], (), (), max(0.0, wake - clock.now()))
        turned, before, waited = clock.now(), waited, time_in_queue()
        for fd in ready:
            if fd in plugged:
                plugged[fd].receive(turned, late=max(busy, waited - before))
            elif not others[fd]():
                del others[fd]
        for terminal in terminals:
            if terminal.next_due <= (now := clock.now()):
                terminal.send(now + EARLY)
        late = max((terminal.too_late for terminal in terminals), default=0.0)
        if late and turned >= warned + WARN_AGAIN:
            warned = turned
            warn(f"this machine is too slow: the emulator was late by {1e3 * late:.0f} ms")
            for terminal in terminals:
                terminal.too_late = 0.0


def time_in_queue() -> float:
    """Return how long this thread has waited for a processor, s; 0 if Linux does not report it."""
    with suppress(OSError, ValueError, IndexError):
        return 1e-9 * int(Path("/proc/thread-self/schedstat").read_bytes().split()[1])
    return 0.0
