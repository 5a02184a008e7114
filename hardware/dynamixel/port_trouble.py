"""Why a serial port cannot be opened or used, said so that a person can act on it."""

import errno
import itertools
import stat
from contextlib import suppress
from pathlib import Path

from serial.tools.list_ports import comports

from hardware.errors import BusError, describe
from hardware.processes import PROCESSES, named_process

_ABSENT = {errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.ENOTDIR, errno.ENAMETOOLONG, errno.ELOOP, errno.EIO}
_BUSY = {errno.EBUSY, errno.EAGAIN}
_FORBIDDEN = {errno.EACCES, errno.EPERM}
_PSEUDO_TERMINALS = Path("/dev/pts")
_MOST_PROCESSES = 100_000
"""Bound of the search for who holds a port."""


def why_not_open(path: str, baud: int, cause: Exception) -> BusError:
    """The error for a port that could not be opened: absent, busy, forbidden, no serial port, no such baud rate."""
    number = getattr(cause, "errno", None)
    if number in _ABSENT:
        return no_such_port(path)
    if number in _BUSY:
        return BusError(describe(what="the port is busy", where=path, found=holders(path), then="Stop it, or wait"))
    if number in _FORBIDDEN:
        return BusError(
            describe(
                what="no permission to open the port",
                where=path,
                found=_owner(path),
                then='Run "sudo usermod -aG dialout $USER", then log out and in again',
            )
        )
    if _is_terminal_device(path) and isinstance(cause, ValueError):
        return BusError(describe(what="no such baud rate", where=path, found=baud, allowed="what the adapter can do"))
    return BusError(
        describe(what="not a serial port", where=path, found=_kind(path), allowed=_existing(), then="Check the path")
    )


def no_such_port(path: str) -> BusError:
    """The error for a path that leads nowhere."""
    return BusError(
        describe(
            what="no such port",
            where=path or "an empty path",
            allowed=_existing(),
            then="Check the cable, the power and the path",
        )
    )


def unplugged(path: str, cause: object) -> BusError:
    """The error for a port that went away while it was open."""
    return BusError(
        describe(what="the port went away", where=path, found=cause, then="Check the cable and the adapter's power")
    )


def not_open(path: str) -> BusError:
    """The error for a port that is used before `open` or after `close`."""
    return BusError(describe(what="the port is not open", where=path))


def wrong_baud(path: str, baud: int, allowed: object) -> BusError:
    """The error for a speed that the line does not run at."""
    return BusError(describe(what="no such baud rate", where=path, found=baud, allowed=allowed))


def holders(path: str, processes: Path = PROCESSES) -> str:
    """Who has the port open, as far as this user may see. What is behind a pseudo-terminal has it open too, and is told
    apart: it keeps nobody out."""
    device = Path(path).resolve()
    found: list[str] = []
    behind: list[str] = []
    for process in itertools.islice(processes.glob("[0-9]*"), _MOST_PROCESSES):
        with suppress(OSError):
            opened = {link.name: link.resolve() for link in (process / "fd").iterdir()}
            if any(_leads_to(device, process, name, target) for name, target in opened.items()):
                name = named_process(process.name, processes)
                what = "the emulator" if "emulate" in name else "its other end"
                behind.append(f"{name} is {what}")
            elif device in opened.values():
                found.append(named_process(process.name, processes))
    return "; ".join([", ".join(found) or "another process", *behind])


def _leads_to(device: Path, process: Path, descriptor: str, target: Path) -> bool:
    """Whether an open file of a process is the master of a pseudo-terminal: its number is the device's name."""
    if device.parent != _PSEUDO_TERMINALS or target.name != "ptmx":
        return False
    told = (process / "fdinfo" / descriptor).read_text(encoding="utf-8", errors="replace")
    return ["tty-index:", device.name] in [line.split() for line in told.splitlines()]


def _existing() -> str:
    ports = sorted(port.device for port in comports())
    return ", ".join(ports) if ports else "none, no serial port exists here"


def _owner(path: str) -> str:
    try:
        place = Path(path)
        return f"owner {place.owner()}, group {place.group()}, mode {stat.filemode(place.stat().st_mode)}"
    except (OSError, KeyError):
        return "no rights"


def _is_terminal_device(path: str) -> bool:
    try:
        return Path(path).is_char_device()
    except (OSError, ValueError):
        return False


def _kind(path: str) -> str:
    try:
        place = Path(path)
        if place.is_dir():
            return "a folder"
        return "a file" if place.is_file() else "something else"
    except (OSError, ValueError):
        return repr(path)
