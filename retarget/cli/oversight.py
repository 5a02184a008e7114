"""Who may stop or hold a live run, and how its ticks are scheduled: as asked on the command line."""

import sys
from dataclasses import dataclass, field
from pathlib import Path

from hardware.realtime import Scheduling, refuse_scheduling
from retarget.errors import UsageError

__all__ = ["Oversight", "refuse_oversight"]


@dataclass(frozen=True, kw_only=True)
class Oversight:
    """stop_file: its appearance stops the robot. dead_man: what must be held so that it moves, see `open_dead_man`.
    control_socket: where other programs may stop it, see `socket_path`; None: nowhere."""

    stop_file: Path | None = None
    dead_man: str | None = None
    control_socket: str | None = None
    scheduling: Scheduling = field(default_factory=Scheduling)


def refuse_oversight(oversight: Oversight, *, virtual: bool) -> None:
    """Raise UsageError or HardwareError for what cannot be had. virtual: as fast as the machine can."""
    file = oversight.stop_file
    if file is not None and file.exists():
        raise UsageError(
            "the file that stops the robot is there already",
            where="--stop-file",
            found=str(file),
            next_step="Remove it",
        )
    if virtual and oversight.dead_man is not None:
        raise UsageError(
            "nobody can hold a key on virtual time",
            where="--dead-man",
            found="a recording on servos that do not exist",
            next_step="Leave it out, or use a live sender",
        )
    refuse_scheduling(oversight.scheduling)


def has_terminal() -> bool:
    """Whether keys can be pressed."""
    return sys.stdin is not None and sys.stdin.isatty()
