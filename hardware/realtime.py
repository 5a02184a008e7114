"""Scheduling of the tick thread: real-time priority and a core of its own (Linux). Also names of other processes.

Memory is not locked (mlockall): a tick allocates next to nothing, and a robot's computer should not swap at all.
"""

import itertools
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from hardware.errors import HardwareError, printable

USUAL_PRIORITY = 40
"""Priority of SCHED_FIFO, 1 to 99: below the kernel's interrupt threads (50 on PREEMPT_RT), which bring what a tick
waits for."""
HOW_TO_PERMIT = 'echo "$USER - rtprio 50" | sudo tee /etc/security/limits.d/retarget.conf, then log in again'
ELSEWHERE = "(systemd: LimitRTPRIO=50; Docker: --cap-add SYS_NICE --ulimit rtprio=50)"


@dataclass(frozen=True, kw_only=True)
class Scheduling:
    """priority: of SCHED_FIFO, 1 to 99; None: the usual one. core: the only one to run on; None: any."""

    priority: int | None = None
    core: int | None = None


@contextmanager
def scheduled(scheduling: Scheduling) -> Iterator[None]:
    """Schedule the calling thread so within the context; threads that it starts do not inherit its priority.

    Raises HardwareError: no such priority or core, or not permitted; with how to permit it.
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
    """Raise HardwareError where `scheduled` would; nothing is changed."""
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


# Other processes of this machine, as far as this user may see them (Linux).

PROCESSES = Path("/proc")
LONGEST = 90
"""Characters of a command line that are shown."""


def named_process(number: int | str, processes: Path = PROCESSES) -> str:
    """Describe a process as a person knows it: `process 12 (retarget servo monitor --robot op3)`, its number alone
    where its command is not known. The interpreter of a script and the folders of both are left out."""
    text = _command(processes / str(number))
    return f"process {number} ({text})" if text else f"process {number}"


MOST_PROCESSES = MOST_SOCKETS = 100_000
"""Bounds of a search."""


def port_holder(port: int, processes: Path = PROCESSES) -> str:
    """The processes that listen on the UDP `port` (IPv4 or IPv6): "process 12 (retarget run)", or "another process"."""
    wanted, found = set[str](), list[str]()
    for table in ("udp", "udp6"):
        with suppress(OSError), (processes / "net" / table).open(encoding="ascii", errors="replace") as lines:
            for line in itertools.islice(lines, 1, MOST_SOCKETS):
                words = line.split()  # the columns `local_address` and `inode`
                if len(words) > 9 and words[1].endswith(f":{port:04X}"):
                    wanted.add(f"socket:[{words[9]}]")
    for process in itertools.islice(processes.glob("[0-9]*"), MOST_PROCESSES) if wanted else ():
        with suppress(OSError):
            if any(str(link.readlink()) in wanted for link in (process / "fd").iterdir()):
                found.append(named_process(process.name, processes))
    return ", ".join(sorted(found)) or "another process"


def _command(process: Path) -> str:
    try:
        words = (process / "cmdline").read_text(encoding="utf-8", errors="replace").rstrip("\0").split("\0")
        if len(words) > 1 and Path(words[0]).name.startswith("python") and not words[1].startswith("-"):
            del words[0]
        words[0] = Path(words[0]).name or (process / "comm").read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""
    text = printable(" ".join(words), one_line=True)
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."
