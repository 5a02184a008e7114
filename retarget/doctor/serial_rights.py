"""Whether this user may open the serial ports of this machine: the group that owns them (dialout, mostly)."""

import grp
import os
import stat
from collections.abc import Iterable
from pathlib import Path

from serial.tools.list_ports import comports

from retarget.doctor.finding import Finding, mend, note, ok

__all__ = ["serial_findings"]

GROUP = "dialout"
"""Owner of serial ports where none is plugged in to look at."""


def serial_findings(ports: Iterable[str] | None = None) -> list[Finding]:
    """ports: paths; None: those that are there."""
    paths = sorted(port.device for port in comports()) if ports is None else list(ports)
    refused = [path for path in paths if not os.access(path, os.R_OK | os.W_OK)]
    found = []
    if refused:
        groups = sorted({group for path in refused if (group := _group(path))})
        told = f"{', '.join(refused)} not for this user (group {', '.join(groups) or 'none'})"
        step = f'Run "sudo usermod -aG {groups[0] if groups else GROUP} $USER", then log out and in again'
        found.append(mend("serial", told, step))
    usable = [path for path in paths if path not in refused]
    if usable:
        found.append(ok("serial", f"{', '.join(usable)} for this user"))
    if not paths:
        found.append(_nothing_there())
    return found


def _group(path: str) -> str:
    """The group that may open a port; "" where its mode gives groups no right, or its name is not known."""
    try:
        mode = Path(path).stat().st_mode
        return Path(path).group() if mode & stat.S_IRGRP and mode & stat.S_IWGRP else ""
    except (OSError, KeyError):
        return ""


def _nothing_there() -> Finding:
    """No port to look at: is this user in the group, at least."""
    if os.geteuid() == 0:
        return ok("serial", "no serial port here; root may open any")
    try:
        number = grp.getgrnam(GROUP).gr_gid
    except KeyError:
        return ok("serial", "no serial port here")
    if number in {*os.getgroups(), os.getegid()}:
        return ok("serial", f"no serial port here; this user is in {GROUP}")
    step = f'For servos: "sudo usermod -aG {GROUP} $USER", then log out and in again'
    return note("serial", f"no serial port here, and this user is not in {GROUP}", step)
