"""Torque on for a whole robot: everything that it needs is written and confirmed first, then the drive rises."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from hardware.dynamixel import torque
from hardware.dynamixel.bus_line import BusLine
from hardware.dynamixel.drive import FIRST_DRIVE, Drive
from hardware.dynamixel.provisioning import provision
from hardware.errors import BusError, HardwareError

RAMP_TIME = 0.5
"""[s] From the first drive to the full one."""
RAMP_STEP = 0.02
"""[s] Between two steps of the ramp."""


class Ready(NamedTuple):
    """One bus as it was before torque. limp: the servos without it."""

    line: BusLine
    limp: tuple[int, ...]


def prepare(lines: Sequence[BusLine], tell: Callable[[str], object], *, limp_only: bool = False) -> list[Ready]:
    """Bring everybody to what the profile wants: limp servos wholly, those that have torque as far as they let.

    limp_only: leave those that have torque as they are. `tell` hears what was changed. Raises BusError with what one
    refuses, and what others have taken by then.
    """
    found, changed = [], list[str]()
    for line in lines:
        limp = tuple(torque.limp(line))
        for device in limp if limp_only else line.servos:
            try:
                now = provision(line, line.servos[device], limp=device in limp)
            except HardwareError as error:
                raise BusError(f"{error} Written before that: {'; '.join(changed) or 'nothing'}.") from error
            if now:
                changed.append(f"servo {line.name_of(device)}: {', '.join(now)}")
                tell(changed[-1])
        line.adopt(line.images)
        found.append(Ready(line, limp))
    return found


def switch_on(ready: Sequence[Ready], goals: Sequence[dict[int, int]]) -> list[Drive]:
    """Send the goals of each bus (by id, ticks), confirm them, and switch torque on with little drive.

    Call `torque.check_still` on all buses before: from here on torque may be on (1.0 servos switch it on when they get
    a goal). Returns the drive of each bus, to be raised. Raises BusError.
    """
    drives = []
    for (line, limp), own in zip(ready, goals, strict=True):
        drives.append(Drive(line, limp))
        drives[-1].confirm(FIRST_DRIVE)
        if len(limp) < len(own):  # whom its watchdog has stopped takes no goal until that is cleared
            torque.arm_watchdogs(line)
        torque.confirm_goals(line, own)
    lines = [line for line, _ in ready]
    for line in lines:
        torque.arm_watchdogs(line)
        torque.feed_watchdogs(lines)
    for line, limp in ready:
        if limp:
            torque.wake(line, limp)
            torque.enable(line, limp)
            torque.feed_watchdogs(lines)
    return drives


def raise_drive(lines: Sequence[BusLine], drives: Sequence[Drive], watch: Callable[[], None]) -> None:
    """From the first drive to the full one, within RAMP_TIME. `watch` is called at every step: what it raises ends it.

    Raises BusError.
    """
    if any(drive.limited for drive in drives):
        port = lines[0].port
        begun, steps = port.now(), round(RAMP_TIME / RAMP_STEP)
        for step in range(1, steps + 1):
            share = FIRST_DRIVE + (1.0 - FIRST_DRIVE) * step / steps
            for drive in drives:
                drive.send(share)
            port.sleep_until(begun + step * RAMP_STEP)
            watch()
    for drive in drives:
        drive.confirm(1.0)
