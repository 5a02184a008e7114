"""A serial port for servos: is it there, may it be opened, who has it, how long its adapter keeps bytes.

Nothing is opened: opening moves the lines of some adapters, and a byte might reach the servos.
"""

import errno
import os
from pathlib import Path

from hardware.dynamixel import latency_timer, port_trouble
from hardware.processes import PROCESSES
from retarget.doctor.finding import Finding, Level, mend, note, ok

__all__ = ["port_findings"]

SUBJECT = "port"
NOBODY = "another process"
"""What is said of holders when none can be seen."""


def port_findings(
    path: str, *, baud: int | None = None, devices: Path = latency_timer.DEVICES, processes: Path = PROCESSES
) -> list[Finding]:
    """baud: of the profile's bus, None: not known."""
    trouble = _trouble(path, baud or 57_600)
    if trouble is not None:
        return [trouble]
    target = Path(path).resolve()
    found = [ok(path, f"there ({target}), and this user may open it")]
    found += _holders(path, processes)
    timer = latency_timer.latency_timer_ms(path, devices)
    if timer is None:
        found.append(ok(path, "no latency timer (the adapter is no FTDI)"))
    elif timer > latency_timer.WANTED_MS:
        told = f"the adapter keeps bytes for up to {timer} ms, and {latency_timer.WANTED_MS} ms is needed"
        step = f"Type: {latency_timer.timer_command(path, devices)}"
        found.append(mend(path, told, step + " (docs/wiring.md has a rule that makes it stay)"))
    else:
        found.append(ok(path, f"latency timer {timer} ms"))
    if baud is not None:
        found.append(ok(path, f"{baud} baud in the profile; retarget servo scan asks who answers"))
    return found


def _trouble(path: str, baud: int) -> Finding | None:
    """Why the port could not be opened, in the words of opening."""
    try:
        there = Path(path).exists()
        is_device = there and Path(path).is_char_device()
    except (OSError, ValueError):
        there = is_device = False
    if not there:
        return Finding(Level.MEND, SUBJECT, str(port_trouble.no_such_port(path)))
    if not is_device:
        cause = OSError(errno.ENOTTY, os.strerror(errno.ENOTTY))
    elif not os.access(path, os.R_OK | os.W_OK):
        cause = OSError(errno.EACCES, os.strerror(errno.EACCES))
    else:
        return None
    return Finding(Level.MEND, SUBJECT, str(port_trouble.why_not_open(path, baud, cause)))


def _holders(path: str, processes: Path) -> list[Finding]:
    """Who has it open; the other end of a pseudo-terminal is not in the way."""
    told = port_trouble.holders(path, processes)
    holder, _, behind = told.partition("; ")
    found = [note(path, behind)] if behind else []
    if holder != NOBODY:
        return [mend(path, f"in use by {holder}", "Stop it, or wait"), *found]
    return [*found, ok(path, "nobody that can be seen has it open")]
