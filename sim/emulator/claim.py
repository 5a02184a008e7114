"""A name that one process of this machine has at a time, and that the system takes back when it ends, killed or not."""

import errno
import hashlib
import os
import socket
import struct
from contextlib import suppress
from pathlib import Path

__all__ = ["Claim"]

_MANY = 4096
"""Processes that may ask who the holder is: it never answers them."""
_CREDENTIALS = struct.Struct("3i")
"""What SO_PEERCRED tells: process, user, group."""


class Claim:
    """A path that is kept by a socket of a name without a file (Linux): nothing is left behind."""

    def __init__(self, path: Path) -> None:
        whole = path.parent.resolve() / path.name
        self._name = b"\0retarget-link-" + hashlib.sha256(os.fsencode(whole)).hexdigest().encode()
        self._socket: socket.socket | None = None

    def take(self) -> bool:
        """Whether it is this one's now, or was. Raises OSError where the system has no such sockets."""
        if self._socket is not None:
            return True
        fresh = socket.socket(socket.AF_UNIX)
        try:
            fresh.bind(self._name)
            fresh.listen(_MANY)
        except OSError as error:
            fresh.close()
            if error.errno == errno.EADDRINUSE:
                return False
            raise
        self._socket = fresh
        return True

    def release(self) -> None:
        """Let others have it."""
        if self._socket is not None:
            self._socket.close()
        self._socket = None

    def holder(self) -> int | None:
        """The process that has it; None where nobody has, or it cannot be told."""
        with suppress(OSError), socket.socket(socket.AF_UNIX) as asking:
            asking.setblocking(False)
            asking.connect(self._name)
            told = asking.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
            return int(_CREDENTIALS.unpack(told)[0]) or None
        return None
