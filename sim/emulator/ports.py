"""Ports to a line of emulated devices: inside this process on any clock, or as a pseudo-terminal with a link."""

import array
import contextlib
import errno
import fcntl
import hashlib
import math
import os
import re
import select
import socket
import struct
import termios
import tty
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from hardware.clock import Clock
from hardware.errors import BusError, HardwareError, describe
from hardware.realtime import named_process
from retarget.errors import UsageError
from sim.emulator.line import Line


class EmulatedPort:
    """A `hardware.dynamixel.serial_port.BytePort` on a given clock. On a virtual one waiting takes no time, and several
    ports may share it; on a real one waiting sleeps."""

    def __init__(self, line: Line, clock: Clock, *, name: str = "emulator") -> None:
        self._line, self._clock, self._name = line, clock, name
        self._open = False

    @property
    def name(self) -> str:
        """Its name in messages."""
        return self._name

    @property
    def baud(self) -> int:
        """Bits per second of the host's side."""
        return self._line.baud

    @property
    def latency(self) -> float:
        """Time in s that the emulated adapter keeps what has arrived."""
        return self._line.timing.latency

    def open(self, baud: int) -> None:
        """Open it. Raises BusError when it is open already."""
        if self._open:
            raise BusError(
                describe(what="the port is busy", where=self._name, then="Close what else uses it, then try again")
            )
        self._require_plugged()
        self._open = True
        self._line.baud = _checked(baud, self._name)
        self.drop()

    def set_baud(self, baud: int) -> None:
        """Change the host's speed; the devices keep theirs."""
        self._require("set the baud rate")
        self._line.baud = _checked(baud, self._name)
        self.drop()

    def write(self, data: bytes) -> None:
        """Send; the line receives it now."""
        self._require("write")
        if data:
            self._line.receive(data, self._clock.now())

    def read(self) -> bytes:
        """What has arrived by now."""
        self._require("read")
        return self._line.take(self._clock.now())

    def wait(self, deadline: float) -> bool:
        """Sleep until something has arrived (True) or until `deadline`."""
        self._require("wait")
        due = self._line.next_due
        self._clock.sleep_until(deadline if due is None else min(due, deadline))
        self._require("wait")
        return due is not None and due <= self._clock.now()

    def drop(self) -> None:
        """Forget what has arrived."""
        self._require("drop")
        self._line.take(self._clock.now())

    def now(self) -> float:
        """The clock, s."""
        return self._clock.now()

    def sleep_until(self, deadline: float) -> None:
        """Return at `deadline`."""
        self._clock.sleep_until(deadline)

    def close(self) -> None:
        """Close it; twice is allowed."""
        self._open = False

    def _require(self, what: str) -> None:
        if not self._open:
            raise BusError(describe(what=f"cannot {what}: the port is closed", where=self._name, then="Open it first"))
        self._require_plugged()

    def _require_plugged(self) -> None:
        if self._line.unplugged(self._clock.now()):
            self._open = False
            raise BusError(
                describe(what="there is no such port", where=self._name, then="Check the adapter and its cable")
            )


def _checked(baud: int, name: str) -> int:
    if baud <= 0:
        raise BusError(describe(what="no such baud rate", where=name, found=baud, allowed="above 0"))
    return baud


# A name that one process of this machine holds at a time. The system releases it when that process ends in any way.

_MANY = 4096
"""Most pending connections of processes that ask for the holder: it never accepts them."""
_CREDENTIALS = struct.Struct("3i")
"""The fields of SO_PEERCRED: process, user, group."""


class Claim:
    """A path that is reserved by an abstract socket (Linux), so no file is left behind."""

    def __init__(self, path: Path) -> None:
        whole = path.parent.resolve() / path.name
        self._name = b"\0retarget-link-" + hashlib.sha256(os.fsencode(whole)).hexdigest().encode()
        self._socket: socket.socket | None = None

    def take(self) -> bool:
        """Take the name; return whether this claim holds it. Raises OSError where the system has no such sockets."""
        if self._socket is not None:
            return True
        fresh = socket.socket(socket.AF_UNIX)
        try:
            fresh.bind(self._name)
            fresh.listen(_MANY)
        except OSError as error:
            fresh.close()
            if error.errno == errno.EADDRINUSE:
                return False
            raise
        self._socket = fresh
        return True

    def release(self) -> None:
        """Release the name."""
        if self._socket is not None:
            self._socket.close()
        self._socket = None

    def holder(self) -> int | None:
        """Return the process that holds the name; None where none does, or the system does not say."""
        with suppress(OSError), socket.socket(socket.AF_UNIX) as asking:
            asking.setblocking(False)
            asking.connect(self._name)
            credentials = asking.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
            return int(_CREDENTIALS.unpack(credentials)[0]) or None
        return None


# A symlink to a pseudo-terminal: made and moved in one step. It never replaces anything that is not ours, and belongs
# to one emulator at a time.

_OURS = re.compile(r"/dev/pts/\d+")
"""Where links of this kind lead."""


class Link:
    """A path by which clients know a line, whatever pseudo-terminal is behind it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._target: str | None = None
        self._claim = Claim(path)

    def check(self) -> None:
        """Reserve the path for this emulator until `remove`. One that a killed emulator left is free.

        Raises UsageError when no link can be made there: no such folder, something of another kind, another emulator.
        """
        folder = self.path.parent
        if not folder.is_dir():
            raise UsageError(
                "there is no such folder for the link",
                where=str(self.path),
                next_step="Make the folder, or name another",
            )
        if not os.access(folder, os.W_OK | os.X_OK):
            raise UsageError(
                "nothing can be made in this folder", where=str(self.path), next_step="Name a folder of your own"
            )
        if os.path.lexists(self.path) and not self._is_ours():
            raise UsageError(
                "the path of the link is taken",
                where=str(self.path),
                found="a folder" if self.path.is_dir() else "something that is no link to a pseudo-terminal",
                allowed="a path where nothing is, or a link that an emulator left",
                next_step="Name another path",
            )

        self._keep()

    def point(self, target: str) -> None:
        """Point the link to `target`, in one step. Raises UsageError."""
        self.check()
        try:
            if self._is_ours():
                fresh = self.path.with_name(f".{self.path.name}.{os.getpid()}")
                fresh.symlink_to(target)
                fresh.replace(self.path)
            else:
                self.path.symlink_to(target)
        except OSError as error:
            raise UsageError(
                f"the link cannot be made: {error.strerror}", where=str(self.path), next_step="Name another path"
            ) from None
        self._target = target

    def remove(self) -> None:
        """Remove the link and release the path."""
        self.hide()
        self._claim.release()

    def hide(self) -> None:
        """Remove the link if it still leads where `point` set it; the path stays reserved."""
        with contextlib.suppress(OSError):
            if self._target is not None and os.readlink(self.path) == self._target:  # noqa: PTH115 - as text, unchanged
                self.path.unlink()
        self._target = None

    def _keep(self) -> None:
        try:
            free = self._claim.take()
        except OSError as error:
            raise UsageError(
                f"the link cannot be kept from other emulators: {error.strerror}", where=str(self.path)
            ) from None
        if not free:
            holder = self._claim.holder()
            raise UsageError(
                "another emulator has this link",
                where=str(self.path),
                found=None if holder is None else named_process(holder),
                next_step="End it, or name another path",
            )

    def _is_ours(self) -> bool:
        try:
            return _OURS.fullmatch(os.readlink(self.path)) is not None  # noqa: PTH115 - as text, unchanged
        except OSError:
            return False


# A line of emulated devices behind a pseudo-terminal: any program that opens a serial port can talk to it (Linux).

CHUNK = 4096
"""Most bytes that are read at once; the kernel keeps no more."""
_TCGETS2, _SPEED_WORD = 0x802C542A, 10
"""Linux's ioctl that reads the speed that a client has set, and its index in the answer."""


class PseudoTerminal:
    """One line and its link. Call `receive` when its `fd` has bytes, `send` when some are due, `follow` when a fault
    may have unplugged or replugged the adapter: then a new pseudo-terminal is behind the same link."""

    def __init__(self, line: Line, link: Link) -> None:
        self.line, self.link = line, link
        self.fd = -1
        """What to wait on; -1 while unplugged."""
        self.path = ""
        """The pseudo-terminal itself."""
        self.lost = 0
        """Bytes that the kernel did not take because no client reads."""
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

    def receive(self, now: float) -> None:
        """Pass what the client has written to the line, at the client's speed."""
        try:
            data = os.read(self.fd, CHUNK)
        except (BlockingIOError, InterruptedError):
            return
        self.line.baud = self._baud()
        self.line.receive(data, now)

    def send(self, now: float) -> None:
        """Pass to the client what has arrived by `now`. What it does not take is lost, as in a real adapter."""
        data = self.line.take(now)
        if data:
            sent = 0
            with contextlib.suppress(BlockingIOError):
                sent = os.write(self.fd, data)
            self.lost += len(data) - sent

    def follow(self, now: float) -> None:
        """Hang up while the line is unplugged, and open again when it is back. The link stays reserved.

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


# Serving lines on pseudo-terminals until the caller stops it; it sleeps whenever nothing is due.

EARLY = 120e-6
"""What is due within so many s is not slept for: a timer is no finer than 50 us, and a round trip through a
pseudo-terminal takes some 70 us, which no adapter has."""
BATCH = 0.3e-3
"""Answers that come within so many s of each other, and no more than the adapter's latency, are handed over together,
when the last of them is due: an adapter passes packets on, not bytes."""
LONGEST_SLEEP = 3600.0
"""Longest single sleep, s."""


def serve(
    terminals: Sequence[PseudoTerminal],
    clock: Clock,
    *,
    until: Callable[[], bool],
    listen: Mapping[int, Callable[[], bool]] | None = None,
    deadline: float = math.inf,
) -> None:
    """Serve opened terminals until `until()` or the `deadline`, s on the clock.

    listen: further file descriptors and what to call when they have something; one whose call returns False is at its
    end and is not waited for any more. A signal is noticed when a descriptor becomes readable by it
    (signal.set_wakeup_fd).
    """
    others = dict(listen or {})
    plugged = _by_fd(terminals)
    while not until():
        now = clock.now()
        if now >= deadline:
            return
        wake, changed = min(deadline, now + LONGEST_SLEEP), False
        for terminal in terminals:
            before = terminal.fd
            wake = min(wake, _attend(terminal, now))
            changed |= terminal.fd != before
        if changed:
            plugged = _by_fd(terminals)
        ready, _, _ = select.select([*plugged, *others], (), (), max(0.0, wake - clock.now()))
        now = clock.now()
        for fd in ready:
            if fd in plugged:
                plugged[fd].receive(now)
            elif not others[fd]():
                del others[fd]


def _by_fd(terminals: Sequence[PseudoTerminal]) -> dict[int, PseudoTerminal]:
    return {terminal.fd: terminal for terminal in terminals if terminal.fd >= 0}


def _attend(terminal: PseudoTerminal, now: float) -> float:
    """Do what is due on a terminal; return when something will be, s."""
    terminal.follow(now)
    line = terminal.line
    span = min(BATCH, line.timing.latency)
    due = line.last_due_within(span)
    if due is not None and due <= now + EARLY:
        terminal.send(now + EARLY)
        due = line.last_due_within(span)
    wake = math.inf if due is None else due - EARLY
    change = line.faults.next_change
    return wake if change is None else min(wake, change)
