"""Who may stop or hold a live run, and how its ticks are scheduled: as asked on the command line."""

import sys
from dataclasses import dataclass, field
from pathlib import Path

from hardware.realtime import Scheduling, refuse_scheduling
from retarget.errors import UsageError

__all__ = ["Oversight", "refuse_oversight", "stop_file_state"]


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
    if oversight.stop_file is not None:
        _refuse_stop_file(oversight.stop_file)
    if virtual and oversight.dead_man is not None:
        raise UsageError(
            "nobody can hold a key on virtual time",
            where="--dead-man",
            found="a recording on servos that do not exist",
            next_step="Leave it out, or use a live sender",
        )
    refuse_scheduling(oversight.scheduling)


def stop_file_state(file: Path) -> str:
    """What is wrong with it for a robot that moves: it is there, or cannot be looked for; "" where it is absent."""
    try:
        file.lstat()  # `exists` says no of what cannot be looked for
    except FileNotFoundError:
        return "" if file.parent.is_dir() else "cannot be looked for (its folder is not there)"
    except (OSError, ValueError) as error:
        return f"cannot be looked for ({getattr(error, 'strerror', None) or error})"
    return "is there"


def _refuse_stop_file(file: Path) -> None:
    """Raise UsageError for a file that would stop the robot at once."""
    state = stop_file_state(file)
    if state:
        there = state == "is there"
        raise UsageError(
            f"the file that stops the robot {state}{' already' if there else ''}",
            where="--stop-file",
            found=str(file),
            next_step="Remove it" if there else "Name one in a folder that is there and yours",
        )


def has_terminal() -> bool:
    """Whether keys can be pressed."""
    return sys.stdin is not None and sys.stdin.isatty()
