"""A local socket on which other programs of this user stop or hold a live run: one word a line, one line back."""

import errno
import os
import socket
import stat
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from pathlib import Path

from retarget.errors import UsageError

USUAL = "usual"
"""What `--control-socket` means without a path."""
WHERE = "--control-socket"
MAX_PATH = 107
"""Bytes of a path that a socket can have (unix(7))."""
MAX_LINE = 64
"""Bytes; a client that sends a longer line is disconnected."""
MOST_CLIENTS = 4
"""At once; a new client takes the place of the oldest one."""
MOST_LINES = 8
"""That are read from one client in one poll."""
CONNECT_S = 1.0


def socket_path(text: str | None) -> Path:
    """The path that is given; for None or "usual", `retarget.sock` in the folder of this user's session.

    Raises UsageError where there is no such folder, or the path is too long.
    """
    if text is None or text == USUAL:
        folder = os.environ.get("XDG_RUNTIME_DIR", "")
        if not Path(folder).is_absolute():
            raise UsageError(
                "XDG_RUNTIME_DIR is not set, so the socket has no usual path",
                where=WHERE,
                next_step="Give a path, here and to `retarget stop --socket`",
            )
        path = Path(folder) / "retarget.sock"
    else:
        path = Path(text)
    length = len(os.fsencode(path))
    if length > MAX_PATH or "\0" in str(path):
        raise UsageError(
            "a socket cannot have this path", where=WHERE, found=f"{length} bytes", allowed=f"{MAX_PATH} bytes"
        )
    return path


def connect_to(path: Path) -> socket.socket:
    """Connect to a socket; blocks for CONNECT_S at most. Raises OSError."""
    client = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        client.settimeout(CONNECT_S)
        client.connect(str(path))
    except BaseException:
        client.close()
        raise
    return client


class ControlSocket(AbstractContextManager["ControlSocket"]):
    """The listener, as a context. Only its owner may connect, and its file is removed at the end.

    Polling never waits, raises nothing that a client causes, and uses bounded memory.
    """

    def __init__(self, path: Path) -> None:
        """Raises UsageError for a path that is in use, is not a socket, or has no folder."""
        self.path = path
        self._clients: dict[socket.socket, bytes] = {}  # what each has sent of its next line; oldest first
        _clear(path)
        self._listener = _listening(path)

    def __exit__(self, *failure: object) -> None:
        for client in [*self._clients]:
            self._drop(client)
        with suppress(OSError):
            self.path.unlink()
        self._listener.close()

    def poll(self, obey: Callable[[str], str]) -> None:
        """Answer the words that have come. obey: carries a word out and returns the line to answer."""
        self._accept()
        for client in [*self._clients]:
            self._receive(client, obey)

    def _accept(self) -> None:
        for _ in range(MOST_CLIENTS):
            try:
                client, _ = self._listener.accept()
            except OSError:  # no client, or one that has left already
                return
            client.setblocking(False)
            if len(self._clients) >= MOST_CLIENTS:
                self._drop(next(iter(self._clients)))
            self._clients[client] = b""

    def _receive(self, client: socket.socket, obey: Callable[[str], str]) -> None:
        try:
            data = client.recv(MAX_LINE * MOST_LINES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        *lines, rest = (self._clients[client] + data).split(b"\n")
        if not data or len(rest) > MAX_LINE:
            self._drop(client)
        else:
            self._clients[client] = rest
        for line in lines[:MOST_LINES]:  # also of a client that did not wait for the answer
            fits = len(line) <= MAX_LINE
            answer = obey(line.decode("ascii", errors="replace").strip()) if fits else "error: too long"
            if client in self._clients:
                self._answer(client, answer)

    def _answer(self, client: socket.socket, text: str) -> None:
        line, sent = text.encode() + b"\n", 0
        with suppress(OSError):
            sent = client.send(line)
        if sent < len(line):  # it does not read
            self._drop(client)

    def _drop(self, client: socket.socket) -> None:
        self._clients.pop(client, None)
        client.close()


def _clear(path: Path) -> None:
    """Remove the file of a socket on which no process listens any more."""
    try:
        mode = path.lstat().st_mode
    except OSError:
        return
    if not stat.S_ISSOCK(mode):
        raise UsageError("this is not a socket", where=f"{WHERE} {path}", next_step="Choose another path")
    try:
        connect_to(path).close()
    except ConnectionRefusedError:
        with suppress(OSError):
            path.unlink()
        return
    except OSError:  # a busy listener, or another user's socket: binding fails with the reason
        pass
    raise UsageError(
        "another run listens there",
        where=f"{WHERE} {path}",
        next_step="Stop it (retarget stop), or choose another path",
    )


def _listening(path: Path) -> socket.socket:
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    before = os.umask(0o177)  # only its owner may connect, from the start
    try:
        listener.setblocking(False)
        listener.bind(str(path))
        listener.listen(MOST_CLIENTS)
    except OSError as error:
        listener.close()
        taken = error.errno == errno.EADDRINUSE
        step = "Choose another path" if taken else "Choose a path in a folder that exists and is yours"
        what = f"cannot listen: {error.strerror or error}"
        raise UsageError(what, where=f"{WHERE} {path}", next_step=step) from error
    finally:
        os.umask(before)
    return listener
