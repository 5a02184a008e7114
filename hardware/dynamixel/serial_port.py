"""Serial adapters: the `BytePort` protocol and its implementation, the latency timer, and errors of opening a port."""

import array
import errno
import fcntl
import itertools
import os
import select
import stat
import sys
import termios
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from serial import Serial
from serial.tools.list_ports import comports

from hardware.clock import Clock
from hardware.errors import BusError
from hardware.processes import MOST_PROCESSES, PROCESSES, named_process

# How long a USB adapter keeps what has arrived: the latency timer of an FTDI chip, in the kernel's own files.

DEVICES = Path("/sys/bus/usb-serial/devices")
ASSUMED = 0.001
"""Latency, s, of an adapter that has no such timer: a USB frame."""
WANTED_MS = 1
"""Latency timer, ms, of an FTDI adapter: the least that its driver takes; usual are 16."""


def timer_file(path: str, devices: Path = DEVICES) -> Path:
    """The kernel's file of the timer of the port at `path`, which may be a link; it exists for FTDI only."""
    return devices / Path(path).resolve().name / "latency_timer"


def latency_timer_ms(path: str, devices: Path = DEVICES) -> int | None:
    """The timer in ms; None for an adapter without one."""
    try:
        return int(timer_file(path, devices).read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None


def latency(timer_ms: int | None) -> float:
    """Longest time, s, that the adapter keeps bytes: the timer, and a USB frame where there is none or it says 0."""
    return timer_ms / 1000 if timer_ms else ASSUMED


def timer_command(path: str, devices: Path = DEVICES) -> str:
    """The command that sets the timer to 1 ms, until the adapter is plugged in again."""
    return f"echo {WANTED_MS} | sudo tee {timer_file(path, devices)}"


def ask_low_latency(line: Serial) -> bool:
    """Ask the kernel for low latency (ASYNC_LOW_LATENCY; no rights needed; an FTDI's timer becomes 1 ms).

    Return whether the driver accepted it: many do not have it.
    """
    try:
        line.set_low_latency_mode(True)
    except (ValueError, OSError, NotImplementedError):
        return False
    return True


# Errors of a serial port, each with what to do about it.

_ABSENT = {errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.ENOTDIR, errno.ENAMETOOLONG, errno.ELOOP, errno.EIO}
_BUSY = {errno.EBUSY, errno.EAGAIN}
_FORBIDDEN = {errno.EACCES, errno.EPERM}
_PSEUDO_TERMINALS = Path("/dev/pts")
TERMINAL = "a device"


def why_not_open(path: str, baud: int, cause: Exception) -> BusError:
    """The error for a port that could not be opened: absent, busy, forbidden, no serial port, no such baud rate."""
    number = getattr(cause, "errno", None)
    if number in _ABSENT:
        return no_such_port(path)
    if number in _BUSY:
        return BusError("the port is busy", where=path, found=holders(path), then="Stop it, or wait")
    if number in _FORBIDDEN:
        return BusError(
            "no permission to open the port",
            where=path,
            found=_owner(path),
            then='Run "sudo usermod -aG dialout $USER", then log out and in again',
        )
    if _kind(path) == TERMINAL and isinstance(cause, ValueError):
        return BusError("no such baud rate", where=path, found=baud, allowed="what the adapter can do")
    return BusError("not a serial port", where=path, found=_kind(path), allowed=_existing(), then="Check the path")


def no_such_port(path: str) -> BusError:
    """The error for a path that leads nowhere."""
    return BusError(
        "no such port",
        where=path or "an empty path",
        allowed=_existing(),
        then="Check the cable, the power and the path; without servos: --bus emulator",
    )


def unplugged(path: str, cause: object) -> BusError:
    """The error for a port that went away while it was open."""
    return BusError("the port went away", where=path, found=cause, then="Check the cable and the adapter's power")


def not_open(path: str) -> BusError:
    """The error for a port that is used before `open` or after `close`."""
    return BusError("the port is not open", where=path)


def wrong_baud(path: str, baud: int, allowed: object) -> BusError:
    """The error for a speed that the line does not run at."""
    return BusError("no such baud rate", where=path, found=baud, allowed=allowed)


def holders(path: str, processes: Path = PROCESSES) -> str:
    """The processes that have the port open, as far as this user may see. The other end of a pseudo-terminal also has
    it open; it is named separately, since it keeps no process out."""
    device = Path(path).resolve()
    found: list[str] = []
    behind: list[str] = []
    for process in itertools.islice(processes.glob("[0-9]*"), MOST_PROCESSES):
        with suppress(OSError):
            opened = {link.name: link.resolve() for link in (process / "fd").iterdir()}
            if any(_leads_to(device, process, name, target) for name, target in opened.items()):
                name = named_process(process.name, processes)
                what = "the emulator" if "emulate" in name else "its other end"
                behind.append(f"{name} is {what}")
            elif device in opened.values():
                found.append(named_process(process.name, processes))
    return "; ".join([", ".join(found) or "another process", *behind])


def is_pseudo_terminal(path: str) -> bool:
    """Whether a port is a pseudo-terminal: every emulator on a port is one, no adapter of real servos is."""
    return Path(path).resolve().parent == _PSEUDO_TERMINALS


def _leads_to(device: Path, process: Path, descriptor: str, target: Path) -> bool:
    """Whether an open file of a process is the master of a pseudo-terminal: its number is the device's name."""
    if device.parent != _PSEUDO_TERMINALS or target.name != "ptmx":
        return False
    text = (process / "fdinfo" / descriptor).read_text(encoding="utf-8", errors="replace")
    return ["tty-index:", device.name] in [line.split() for line in text.splitlines()]


def existing_ports() -> dict[str, str]:
    """The serial ports of this machine, in order, each with what is behind it in words ("" where that is not known)."""
    unknown = ("", "n/a")
    found = {port.device: port.description for port in comports()}
    return {path: "" if found[path] in unknown else found[path] for path in sorted(found)}


def _existing() -> str:
    return ports_text(existing_ports())


def ports_text(ports: Mapping[str, str]) -> str:
    """Ports (see `existing_ports`) in one line."""
    shown = [f"{path} ({what})" if what else path for path, what in ports.items()]
    return ", ".join(shown) or "none, no serial port exists here"


BY_ID = Path("/dev/serial/by-id")
"""Links to ports, by maker and number of the adapter: they stay the same when adapters are plugged in otherwise."""


def stable_name(path: str, links: Path = BY_ID) -> str:
    """The link to this port that stays the same; the port itself where there is none."""
    with suppress(OSError):
        target = Path(path).resolve()
        return next((str(link) for link in sorted(links.iterdir()) if link.resolve() == target), path)
    return path


def _owner(path: str) -> str:
    try:
        place = Path(path)
        return f"owner {place.owner()}, group {place.group()}, mode {stat.filemode(place.stat().st_mode)}"
    except (OSError, KeyError):
        return "no rights"


def _kind(path: str) -> str:
    with suppress(OSError, ValueError):
        mode = Path(path).stat().st_mode
        kinds = {stat.S_IFCHR: TERMINAL, stat.S_IFDIR: "a folder", stat.S_IFREG: "a file"}
        return kinds.get(stat.S_IFMT(mode), "something else")
    return repr(path)


LOWEST_BAUD, HIGHEST_BAUD = 1_200, 12_000_000
"""Bounds of the speeds that are tried; not all adapters have them."""
BAUD_TOLERANCE = 0.03
"""Relative error of the real speed beyond which 8N1 bytes are no longer read safely."""
CHUNK = 65_536
"""Most bytes that one read takes."""
STUCK = 0.1
"""An adapter that takes no byte for so long, s, beyond the time of the bytes themselves, is stuck."""
_TCGETS2, _SPEED_WORD = 0x802C542A, 10
"""Linux's ioctl that returns the real speed of a line, and the speed's place in the answer."""


class SerialPort:
    """A `BytePort` over a real tty. Every failure is a BusError; no method lets an OSError through."""

    def __init__(self, path: str, clock: Clock) -> None:
        self._clock = clock
        self.name = path
        """The path it was made with."""
        self._serial: Serial | None = None
        self._fd = -1
        self.baud = 0
        """Bits per second; 0 before `open`."""
        self.latency_timer_ms: int | None = None
        """The adapter's latency timer as of `open`; None where there is none (not an FTDI)."""

    @property
    def latency(self) -> float:
        """Longest time, s, that the adapter keeps what has arrived; 1 ms is assumed where it is not known."""
        return latency(self.latency_timer_ms)

    @property
    def latency_command(self) -> str | None:
        """The command that sets the latency timer to 1 ms; None where that is not needed."""
        if self.latency_timer_ms is None or self.latency_timer_ms <= WANTED_MS:
            return None
        return timer_command(self.name)

    def open(self, baud: int) -> None:
        """Open it for this process alone; what had arrived is dropped. Raises BusError."""
        self.close()
        self._check_baud(baud)
        try:
            self._serial = Serial(port=self.name, baudrate=baud, timeout=0, write_timeout=0, exclusive=True)
            self._fd = self._serial.fileno()
            if not is_pseudo_terminal(self.name):
                # pyserial's lock keeps out processes that lock too, the kernel's all but those of root. The emulator
                # holds a pseudo-terminal open, so there the kernel's lock would outlive a client that was killed.
                fcntl.ioctl(self._fd, termios.TIOCEXCL)
            self._verify_baud(baud)
            ask_low_latency(self._serial)
        except (OSError, termios.error, ValueError, OverflowError) as cause:
            self.close()
            raise why_not_open(self.name, baud, _with_number(cause)) from cause
        except BusError:
            self.close()
            raise
        self.baud = baud
        self.latency_timer_ms = latency_timer_ms(self.name)

    def set_baud(self, baud: int) -> None:
        """Change the speed; what had arrived is dropped. Raises BusError; a refused speed leaves the old one."""
        line = self._serial
        if line is None:
            raise not_open(self.name)
        self._check_baud(baud)
        try:
            self._change_baud(line, baud)
            self._verify_baud(baud)
        except BusError:
            self._change_baud(line, self.baud)
            raise
        self.baud = baud
        self.drop()

    def write(self, data: bytes) -> None:
        """Send; the kernel takes the bytes, so it returns before they are on the wire."""
        fd = self._open_fd()
        try:
            sent = os.write(fd, data)
        except BlockingIOError:
            sent = 0
        except OSError as cause:
            raise self._gone(cause) from cause
        if sent < len(data):
            self._write_rest(fd, data[sent:])

    def read(self) -> bytes:
        """What has arrived, maybe nothing. Never waits."""
        fd = self._open_fd()
        try:
            data = os.read(fd, CHUNK)
        except BlockingIOError:
            return b""
        except OSError as cause:
            raise self._gone(cause) from cause
        if not data and self._hung_up(fd):
            raise self._gone("the end of the line")
        return data

    def wait(self, deadline: float) -> bool:
        """Sleep in the kernel until something has arrived (True; also when the port went away: the next `read` says
        so) or until `deadline`, s."""
        fd = self._open_fd()
        try:
            ready, _, _ = select.select((fd,), (), (), max(0.0, deadline - self._clock.now()))
        except (OSError, ValueError) as cause:
            raise self._gone(cause) from cause
        return bool(ready)

    def drop(self) -> None:
        """Forget what has arrived."""
        try:
            termios.tcflush(self._open_fd(), termios.TCIFLUSH)
        except (OSError, termios.error) as cause:
            raise self._gone(cause) from cause

    def now(self) -> float:
        """Monotonic s of the clock it was made with."""
        return self._clock.now()

    def sleep_until(self, deadline: float) -> None:
        """Return at `deadline`, in s."""
        self._clock.sleep_until(deadline)

    def close(self) -> None:
        """Close it; twice is allowed, and so is closing what never was open."""
        line, fd = self._serial, self._fd
        self._serial, self._fd, self.baud = None, -1, 0
        if line is None:
            return
        if fd >= 0 and not is_pseudo_terminal(self.name):
            with suppress(OSError):  # an adapter that is gone holds nothing
                fcntl.ioctl(fd, termios.TIOCNXCL)
        with suppress(OSError):
            line.close()

    def _open_fd(self) -> int:
        if self._fd < 0:
            raise not_open(self.name)
        return self._fd

    def _check_baud(self, baud: int) -> None:
        if not LOWEST_BAUD <= baud <= HIGHEST_BAUD:
            raise wrong_baud(self.name, baud, f"{LOWEST_BAUD} to {HIGHEST_BAUD}")

    def _change_baud(self, line: Serial, baud: int) -> None:
        try:
            line.baudrate = baud
        except (ValueError, OverflowError) as cause:
            raise wrong_baud(self.name, baud, "what the adapter can do") from cause
        except (OSError, termios.error) as cause:
            raise self._gone(cause) from cause

    def _verify_baud(self, baud: int) -> None:
        """Drivers silently fall back to a speed that they can do: ask which. Raises BusError."""
        real = real_baud(self._fd)
        if real and abs(real - baud) > BAUD_TOLERANCE * baud:
            raise wrong_baud(self.name, baud, f"what the adapter can do; it fell back to {real}")

    def _write_rest(self, fd: int, data: bytes) -> None:
        """Send what the driver's buffer did not hold. Raises BusError when it takes nothing for too long."""
        deadline = self.now() + STUCK + 10 * len(data) / self.baud
        while data:
            try:
                _, ready, _ = select.select((), (fd,), (), max(0.0, deadline - self.now()))
                if not ready:
                    raise self._gone("an adapter that takes no bytes")
                data = data[os.write(fd, data) :]
            except BlockingIOError:
                continue
            except (OSError, ValueError) as cause:
                raise self._gone(cause) from cause

    def _hung_up(self, fd: int) -> bool:
        """Whether the port is gone, so that nothing will ever come."""
        poll = select.poll()
        poll.register(fd, select.POLLIN)
        return any(event & (select.POLLHUP | select.POLLERR | select.POLLNVAL) for _, event in poll.poll(0))

    def _gone(self, cause: object) -> BusError:
        return unplugged(self.name, _with_number(cause) if isinstance(cause, Exception) else cause)


def _with_number(cause: Exception) -> Exception:
    """A termios error as an OSError, whose `errno` is set."""
    if isinstance(cause, termios.error) and len(cause.args) == 2:
        return OSError(*cause.args)
    return cause


def real_baud(fd: int) -> int | None:
    """Speed that the driver reports; None where it reports none."""
    if not sys.platform.startswith("linux"):
        return None
    answer = array.array("I", [0] * 16)
    try:
        fcntl.ioctl(fd, _TCGETS2, answer)
    except OSError:
        return None
    return answer[_SPEED_WORD]


# A line of bytes to servos: through a serial adapter, or to an emulator in this process.


class BytePort(Protocol):
    """Half-duplex bytes with a clock. Every method raises BusError when the port is gone."""

    @property
    def name(self) -> str:
        """Name of the port in messages: the device's path."""

    @property
    def baud(self) -> int:
        """Bits per second; ten of them carry a byte."""

    @property
    def latency(self) -> float:
        """Longest time, s, that the adapter keeps what has arrived (FTDI: the latency timer)."""

    def open(self, baud: int) -> None:
        """Open it, for this process alone. Raises BusError: no such port, busy, not permitted, no such baud rate."""

    def set_baud(self, baud: int) -> None:
        """Change the speed; what had arrived is dropped."""

    def write(self, data: bytes) -> None:
        """Send; returns before the bytes are on the wire."""

    def read(self) -> bytes:
        """What has arrived, maybe nothing. Never waits."""

    def wait(self, deadline: float) -> bool:
        """Sleep until something has arrived (True) or until `deadline`, s on the clock."""

    def drop(self) -> None:
        """Forget what has arrived."""

    def now(self) -> float:
        """Monotonic s: the clock that deadlines are on."""

    def sleep_until(self, deadline: float) -> None:
        """Return at `deadline`, in s."""

    def close(self) -> None:
        """Close it; twice is allowed."""


QUIET = 20e-3
"""[s] After an answer that did not come: what is later than this is not expected."""


def settle(port: BytePort) -> None:
    """Drop an answer that comes late. A status does not say which request it answers, so it would be taken for the
    next.

    Raises BusError when the port is gone.
    """
    deadline = port.now() + QUIET + port.latency
    while port.now() < deadline and port.wait(deadline):
        port.read()


# The message about an adapter that gives back what is sent.

ECHOES = "the adapter echoes what is sent: it works, but costs time in every request; switch its local echo off"
