"""A symlink to a pseudo-terminal: made and moved in one step, never in the place of anything that is not ours, and of
one emulator at a time."""

import contextlib
import os
import re
from pathlib import Path

from hardware.processes import named_process
from retarget.errors import UsageError
from sim.emulator.claim import Claim

_OURS = re.compile(r"/dev/pts/\d+")
"""Where links of this kind lead."""


class Link:
    """A path by which clients know a line, whatever pseudo-terminal is behind it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._target: str | None = None
        self._claim = Claim(path)

    def check(self) -> None:
        """Keep the path for this emulator until `remove`. One that a killed emulator left is free.

        Raises UsageError when no link can be made there: no such folder, something of another kind, another emulator.
        """
        folder = self.path.parent
        if not folder.is_dir():
            raise UsageError(
                "there is no such folder for the link",
                where=str(self.path),
                next_step="Make the folder, or name another",
            )
        if not os.access(folder, os.W_OK | os.X_OK):
            raise UsageError(
                "nothing can be made in this folder", where=str(self.path), next_step="Name a folder of your own"
            )
        if os.path.lexists(self.path) and not self._is_ours():
            raise UsageError(
                "the path of the link is taken",
                where=str(self.path),
                found="a folder" if self.path.is_dir() else "something that is no link to a pseudo-terminal",
                allowed="a path where nothing is, or a link that an emulator left",
                next_step="Name another path",
            )

        self._keep()

    def point(self, target: str) -> None:
        """Let it lead to `target`, in one step. Raises UsageError."""
        self.check()
        try:
            if self._is_ours():
                fresh = self.path.with_name(f".{self.path.name}.{os.getpid()}")
                fresh.symlink_to(target)
                fresh.replace(self.path)
            else:
                self.path.symlink_to(target)
        except OSError as error:
            raise UsageError(
                f"the link cannot be made: {error.strerror}", where=str(self.path), next_step="Name another path"
            ) from None
        self._target = target

    def remove(self) -> None:
        """Take it away, and let other emulators have the path."""
        self.hide()
        self._claim.release()

    def hide(self) -> None:
        """Take it away, if it still leads where `point` let it; the path is kept."""
        with contextlib.suppress(OSError):
            if self._target is not None and os.readlink(self.path) == self._target:  # noqa: PTH115 - as text, unchanged
                self.path.unlink()
        self._target = None

    def _keep(self) -> None:
        try:
            free = self._claim.take()
        except OSError as error:
            raise UsageError(
                f"the link cannot be kept from other emulators: {error.strerror}", where=str(self.path)
            ) from None
        if not free:
            holder = self._claim.holder()
            raise UsageError(
                "another emulator has this link",
                where=str(self.path),
                found=None if holder is None else named_process(holder),
                next_step="End it, or name another path",
            )

    def _is_ours(self) -> bool:
        try:
            return _OURS.fullmatch(os.readlink(self.path)) is not None  # noqa: PTH115 - as text, unchanged
        except OSError:
            return False
