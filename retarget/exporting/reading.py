"""The readers of recorded runs, by the suffix of the file."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from retarget.errors import InputError
from retarget.exporting.mcap_reader import read_mcap_human, read_mcap_run
from retarget.exporting.motion import Motion
from retarget.exporting.npz_reader import read_npz_human, read_npz_run

__all__ = ["READERS", "Reader", "read_run"]


@dataclass(frozen=True)
class Reader:
    """How files of one kind are read: robot (path, body instead of the file's own, or None), human (path)."""

    robot: Callable[[Path, Path | None], Motion]
    human: Callable[[Path], Motion]


READERS = {
    ".npz": Reader(lambda path, body: read_npz_run(path, body=body), read_npz_human),
    ".mcap": Reader(lambda path, body: read_mcap_run(path, body=body), read_mcap_human),
}
"""Suffix -> reader. Whoever adds a format adds a line here."""


def read_run(path: Path, *, of_human: bool = False, body: Path | None = None) -> Motion:
    """The motion of a recorded run: of its robot, or of the virtual human that the robot followed.

    body: MJCF or URDF of the robot, where the one that the file names is not there any more. Raises InputError.
    """
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(
            "not a recorded run",
            where=str(path)[:200],
            found=path.suffix or "no suffix",
            allowed=", ".join(READERS),
            next_step="Give a file that `retarget run` wrote with --save FILE.npz or --record FILE.mcap",
        )
    return reader.human(path) if of_human else reader.robot(path, body)
