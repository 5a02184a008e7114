"""Which process holds a port of this machine, as far as this user may see it (Linux)."""

import itertools
from contextlib import suppress
from pathlib import Path
from typing import Literal

from hardware.processes import PROCESSES, named_process

__all__ = ["port_holder"]

MOST_PROCESSES = 100_000
MOST_SOCKETS = 100_000
"""Bounds of the search."""


def port_holder(port: int, processes: Path = PROCESSES, *, protocol: Literal["udp", "tcp"] = "udp") -> str:
    """Who listens on the `port` (IPv4 or IPv6): "process 12 (retarget run)", or "another process"."""
    wanted = {f"socket:[{inode}]" for inode in _inodes(port, processes, protocol)}
    found: list[str] = []
    for process in itertools.islice(processes.glob("[0-9]*"), MOST_PROCESSES) if wanted else ():
        with suppress(OSError):
            if any(str(link.readlink()) in wanted for link in (process / "fd").iterdir()):
                found.append(named_process(process.name, processes))
    return ", ".join(sorted(found)) or "another process"


def _inodes(port: int, processes: Path, protocol: str) -> set[str]:
    """Inode numbers of the sockets bound to a port: columns `local_address` and `inode` of /proc/net/udp."""
    inodes = set()
    for table in (protocol, protocol + "6"):
        with suppress(OSError), (processes / "net" / table).open(encoding="ascii", errors="replace") as lines:
            for line in itertools.islice(lines, 1, MOST_SOCKETS):
                words = line.split()
                if len(words) > 9 and words[1].endswith(f":{port:04X}"):
                    inodes.add(words[9])
    return inodes
