"""Scheduling of the tick thread: real-time priority and a core of its own (Linux).

Memory is not locked (mlockall), since a tick allocates next to nothing.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

from hardware.errors import HardwareError

USUAL_PRIORITY = 40
"""Priority of SCHED_FIFO, below the kernel's interrupt threads (50 on PREEMPT_RT), on which a tick waits."""
HOW_TO_PERMIT = 'echo "$USER - rtprio 50" | sudo tee /etc/security/limits.d/retarget.conf, then log in again'
ELSEWHERE = "(systemd: LimitRTPRIO=50; Docker: --cap-add SYS_NICE --ulimit rtprio=50)"


@dataclass(frozen=True, kw_only=True)
class Scheduling:
    """priority: of SCHED_FIFO, 1 to 99; None: unchanged. core: the only one to run on; None: any."""

    priority: int | None = None
    core: int | None = None


@contextmanager
def scheduled(scheduling: Scheduling) -> Iterator[None]:
    """Schedule the calling thread within the context. Threads that it starts do not inherit the priority.

    Raises HardwareError with the remedy.
    """
    policy, parameter, cores = os.sched_getscheduler(0), os.sched_getparam(0), os.sched_getaffinity(0)
    try:
        if scheduling.core is not None:
            _pin(scheduling.core, cores)
        if scheduling.priority is not None:
            _set_priority(scheduling.priority)
        yield
    finally:
        with suppress(OSError):
            os.sched_setscheduler(0, policy, parameter)
        with suppress(OSError):
            os.sched_setaffinity(0, cores)


def refuse_scheduling(scheduling: Scheduling) -> None:
    """Raise HardwareError if `scheduled` would; change nothing."""
    with scheduled(scheduling):
        pass


def _pin(core: int, usable: set[int]) -> None:
    try:
        os.sched_setaffinity(0, {core})
    except (OSError, OverflowError, ValueError) as error:  # the second and third: beyond any core, or negative
        allowed = ", ".join(str(number) for number in sorted(usable))
        raise HardwareError(
            "this core cannot be had", where="--core", found=core, allowed=allowed, then="Choose another"
        ) from error


def _set_priority(priority: int) -> None:
    least, most = os.sched_get_priority_min(os.SCHED_FIFO), os.sched_get_priority_max(os.SCHED_FIFO)
    if not least <= priority <= most:
        allowed = f"{least} to {most}; usual is {USUAL_PRIORITY}"
        raise HardwareError("no such real-time priority", where="--realtime", found=priority, allowed=allowed)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except PermissionError as error:
        raise HardwareError(
            f"real-time priority {priority} is not permitted to this user",
            where="--realtime",
            then=f"Permit it: {HOW_TO_PERMIT} {ELSEWHERE}; or leave --realtime out",
        ) from error
    except OSError as error:
        raise HardwareError(f"no real-time priority here: {error.strerror or error}", where="--realtime") from error
