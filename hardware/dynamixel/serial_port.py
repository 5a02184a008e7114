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

DEVICES = Path("/sys/bus/usb-serial/devices")
ASSUMED = 0.001
"""Latency, s, of an adapter without a latency timer: a USB frame."""
LOW_TIMER_MS = 1
"""Lowest latency timer, ms, of an FTDI adapter (default: 16)."""


def timer_file(path: str, devices: Path = DEVICES) -> Path:
    """The kernel's file of a port's latency timer (FTDI only)."""
    return devices / Path(path).resolve().name / "latency_timer"


def latency_timer_ms(path: str, devices: Path = DEVICES) -> int | None:
    """The latency timer, ms, or None."""
    try:
        return int(timer_file(path, devices).read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None


def timer_command(path: str, devices: Path = DEVICES) -> str:
    """The command that sets the timer to 1 ms."""
    return f"echo {LOW_TIMER_MS} | sudo tee {timer_file(path, devices)}"


def request_low_latency(line: Serial) -> bool:
    """Set ASYNC_LOW_LATENCY, which needs no rights. Return True if the driver supports it."""
    try:
        line.set_low_latency_mode(True)
    except (ValueError, OSError, NotImplementedError):
        return False
    return True


_ABSENT = {errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.ENOTDIR, errno.ENAMETOOLONG, errno.ELOOP, errno.EIO}
_BUSY = {errno.EBUSY, errno.EAGAIN}
_FORBIDDEN = {errno.EACCES, errno.EPERM}
_PSEUDO_TERMINALS = Path("/dev/pts")
TERMINAL = "a device"


def why_not_open(path: str, baud: int, cause: Exception) -> BusError:
    """The error for a port that could not be opened."""
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
    """The error for a missing path."""
    return BusError(
        "no such port",
        where=path or "an empty path",
        allowed=_existing(),
        then="Check the cable, the power and the path; without servos: --bus emulator",
    )


def wrong_baud(path: str, baud: int, allowed: object) -> BusError:
    """The error for an impossible speed."""
    return BusError("no such baud rate", where=path, found=baud, allowed=allowed)


def holders(path: str, processes: Path = PROCESSES) -> str:
    """Name the processes that have the port open. The other end of a pseudo-terminal, which blocks none, is named
    separately."""
    device = Path(path).resolve()
    found: list[str] = []
    behind: list[str] = []
    for process in itertools.islice(processes.glob("[0-9]*"), MOST_PROCESSES):
        with suppress(OSError):
            opened = {link.name: link.resolve() for link in (process / "fd").iterdir()}
            if any(_is_master(device, process, name, target) for name, target in opened.items()):
                name = named_process(process.name, processes)
                what = "the emulator" if "emulate" in name else "its other end"
                behind.append(f"{name} is {what}")
            elif device in opened.values():
                found.append(named_process(process.name, processes))
    return "; ".join([", ".join(found) or "another process", *behind])


def is_pseudo_terminal(path: str) -> bool:
    """True for a pseudo-terminal, as of an emulator."""
    return Path(path).resolve().parent == _PSEUDO_TERMINALS


def _is_master(device: Path, process: Path, descriptor: str, target: Path) -> bool:
    if device.parent != _PSEUDO_TERMINALS or target.name != "ptmx":
        return False
    text = (process / "fdinfo" / descriptor).read_text(encoding="utf-8", errors="replace")
    return ["tty-index:", device.name] in [line.split() for line in text.splitlines()]


def existing_ports() -> dict[str, str]:
    """The serial ports of this machine, with descriptions."""
    unknown = ("", "n/a")
    found = {port.device: port.description for port in comports()}
    return {path: "" if found[path] in unknown else found[path] for path in sorted(found)}


def _existing() -> str:
    return ports_text(existing_ports())


def ports_text(ports: Mapping[str, str]) -> str:
    """Return ports (see `existing_ports`) in one line."""
    shown = [f"{path} ({what})" if what else path for path, what in ports.items()]
    return ", ".join(shown) or "none, no serial port exists here"


BY_ID = Path("/dev/serial/by-id")
"""Stable links to ports."""


def stable_name(path: str) -> str:
    """The stable link to a port, if any."""
    with suppress(OSError):
        target = Path(path).resolve()
        return next((str(link) for link in sorted(BY_ID.iterdir()) if link.resolve() == target), path)
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
BAUD_TOLERANCE = 0.03
"""Relative error of the real speed beyond which bytes are not read safely."""
READ_BYTES = 65_536
STUCK = 0.1
"""Time, s, after which an adapter that takes no bytes is stuck."""
_TCGETS2, _SPEED_WORD = 0x802C542A, 10
"""Linux's ioctl for the real speed of a line."""


class SerialPort:
    """A `BytePort` on a real tty."""

    def __init__(self, path: str, clock: Clock) -> None:
        self._clock = clock
        self.name = path
        self._serial: Serial | None = None
        self._fd = -1
        self.baud = 0
        """Bits per second; 0 while closed."""
        self.latency_timer_ms: int | None = None
        """[ms] As of `open`; None without one."""

    @property
    def latency(self) -> float:
        """See `BytePort`."""
        return self.latency_timer_ms / 1000 if self.latency_timer_ms else ASSUMED

    @property
    def latency_command(self) -> str | None:
        """Command that sets the timer to 1 ms, if needed."""
        if self.latency_timer_ms is None or self.latency_timer_ms <= LOW_TIMER_MS:
            return None
        return timer_command(self.name)

    def open(self, baud: int) -> None:
        """See `BytePort`."""
        self.close()
        self._check_baud(baud)
        try:
            self._serial = Serial(port=self.name, baudrate=baud, timeout=0, write_timeout=0, exclusive=True)
            self._fd = self._serial.fileno()
            if not is_pseudo_terminal(self.name):
                # Unlike pyserial's lock, the kernel's excludes all processes but root's. On a pseudo-terminal, held
                # open by the emulator, it would outlive a killed client.
                fcntl.ioctl(self._fd, termios.TIOCEXCL)
            self._verify_baud(baud)
            request_low_latency(self._serial)
        except (OSError, termios.error, ValueError, OverflowError) as cause:
            self.close()
            raise why_not_open(self.name, baud, _with_number(cause)) from cause
        except BusError:
            self.close()
            raise
        self.baud = baud
        self.latency_timer_ms = latency_timer_ms(self.name)

    def set_baud(self, baud: int) -> None:
        """See `BytePort`. A refused speed leaves the old one."""
        self._open_fd()
        line = self._serial
        assert line is not None
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
        """See `BytePort`."""
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
        """See `BytePort`."""
        fd = self._open_fd()
        try:
            data = os.read(fd, READ_BYTES)
        except BlockingIOError:
            return b""
        except OSError as cause:
            raise self._gone(cause) from cause
        if not data:  # the end of the line, or a lost port
            poll = select.poll()
            poll.register(fd, select.POLLIN)
            if any(event & (select.POLLHUP | select.POLLERR | select.POLLNVAL) for _, event in poll.poll(0)):
                raise self._gone("the end of the line")
        return data

    def wait(self, deadline: float) -> bool:
        """See `BytePort`. A lost port also ends the wait."""
        fd = self._open_fd()
        try:
            ready, _, _ = select.select((fd,), (), (), max(0.0, deadline - self._clock.now()))
        except (OSError, ValueError) as cause:
            raise self._gone(cause) from cause
        return bool(ready)

    def drop(self) -> None:
        """See `BytePort`."""
        try:
            termios.tcflush(self._open_fd(), termios.TCIFLUSH)
        except (OSError, termios.error) as cause:
            raise self._gone(cause) from cause

    def now(self) -> float:
        """See `BytePort`."""
        return self._clock.now()

    def sleep_until(self, deadline: float) -> None:
        """See `BytePort`."""
        self._clock.sleep_until(deadline)

    def close(self) -> None:
        """See `BytePort`."""
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
            raise BusError("the port is not open", where=self.name)
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
        """Raise BusError if the driver has silently chosen another speed."""
        real = real_baud(self._fd)
        if real and abs(real - baud) > BAUD_TOLERANCE * baud:
            raise wrong_baud(self.name, baud, f"what the adapter can do; it fell back to {real}")

    def _write_rest(self, fd: int, data: bytes) -> None:
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

    def _gone(self, cause: object) -> BusError:
        found = _with_number(cause) if isinstance(cause, Exception) else cause
        then = "Check the cable and the adapter's power"
        return BusError("the port went away", where=self.name, found=found, then=then)


def _with_number(cause: Exception) -> Exception:
    if isinstance(cause, termios.error) and len(cause.args) == 2:
        return OSError(*cause.args)
    return cause


def real_baud(fd: int) -> int | None:
    """The speed that the driver reports, or None."""
    if not sys.platform.startswith("linux"):
        return None
    answer = array.array("I", [0] * 16)
    try:
        fcntl.ioctl(fd, _TCGETS2, answer)
    except OSError:
        return None
    return answer[_SPEED_WORD]


class BytePort(Protocol):
    """Half-duplex bytes with a clock, through an adapter or to an emulator. Every method raises BusError when the port
    is lost."""

    @property
    def name(self) -> str:
        """Name of the port in messages."""

    @property
    def baud(self) -> int:
        """Bits per second; ten bits carry a byte."""

    @property
    def latency(self) -> float:
        """Longest time, s, for which the adapter keeps bytes (FTDI: the latency timer)."""

    def open(self, baud: int) -> None:
        """Open the port for this process alone."""

    def set_baud(self, baud: int) -> None:
        """Change the speed, and drop the input."""

    def write(self, data: bytes) -> None:
        """Send. Returns before the bytes are on the wire."""

    def read(self) -> bytes:
        """The bytes that have arrived, without waiting."""

    def wait(self, deadline: float) -> bool:
        """Sleep until bytes have arrived (True) or until `deadline`, s."""

    def drop(self) -> None:
        """Drop the input."""

    def now(self) -> float:
        """The monotonic time, s."""

    def sleep_until(self, deadline: float) -> None:
        """Return at `deadline`, s."""

    def close(self) -> None:
        """Close the port. Closing twice is allowed."""


QUIET = 20e-3
"""[s] After a missing answer. Nothing is expected later."""


def settle(port: BytePort) -> None:
    """Drop a late answer, which would be taken for that of the next request."""
    deadline = port.now() + QUIET + port.latency
    while port.now() < deadline and port.wait(deadline):
        port.read()


ECHOES = "the adapter echoes what is sent: it works, but costs time in every request; switch its local echo off"
