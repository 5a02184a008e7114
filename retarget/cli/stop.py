"""`retarget stop`: stop a live run through its `--control-socket`.

It sends its word with `os` and `socket` alone, before anything else is imported.
"""

import os
import socket

TYPE_CHECKING = False  # `typing` takes as long to import as a stop to be sent
if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

WHERE = "--control-socket"
MAX_PATH = 107
"""Most bytes of the path of a socket (unix(7))."""
USUAL = "usual"
"""Value of `--control-socket` without a path."""
MAX_LINE = 64
"""Most bytes of a line. A client that sends a longer one is disconnected."""
CONNECT_S = 1.0
"""Longest time, s, to connect to a control socket."""
PATIENCE_S = 2.0
"""Longest wait, s, for the answer of a run, which reads its socket in every tick."""


def usual_path(text: str | None) -> str:
    """The given path. None or "usual": `retarget.sock` in the folder of this user's session, "" without one."""
    if text is not None and text != USUAL:
        return text
    folder = os.environ.get("XDG_RUNTIME_DIR", "")
    return os.path.join(folder, "retarget.sock") if os.path.isabs(folder) else ""  # noqa: PTH117, PTH118 - see above


def socket_path(text: str | None) -> "Path":
    """The path of a control socket, by `usual_path`. Raises UsageError without one, and for one that is too long."""
    from pathlib import Path

    from retarget.errors import UsageError

    path = usual_path(text)
    if not path and text in (None, USUAL):
        raise UsageError(
            "XDG_RUNTIME_DIR is not set, so the socket has no usual path",
            where=WHERE,
            next_step="Give one: `retarget run --control-socket PATH` and `retarget stop PATH`",
        )
    length = len(os.fsencode(path))
    if length > MAX_PATH or "\0" in path:
        raise UsageError(
            "a socket cannot have this path", where=WHERE, found=f"{length} bytes", allowed=f"{MAX_PATH} bytes"
        )
    return Path(path)


def connect_to(path: "str | os.PathLike[str]") -> socket.socket:
    """Connect to a socket, within CONNECT_S. Raises OSError."""
    client = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        client.settimeout(CONNECT_S)
        client.connect(os.fspath(path))
    except BaseException:
        client.close()
        raise
    return client


def sent(words: "Sequence[str]") -> socket.socket | None:
    """Send the stop of the words behind `stop`. Returns the connection, or None if nothing was sent."""
    paths = [word for word in words if word != "--torque-off"]
    if len(paths) > 1 or any(path.startswith("-") for path in paths):
        return None
    try:
        return _sent(usual_path(paths[0] if paths else None), torque_off=len(words) > len(paths))
    except (OSError, ValueError):  # ValueError: a path that no system can have
        return None


def _sent(path: "str | os.PathLike[str]", *, torque_off: bool) -> socket.socket:
    client = connect_to(path)
    try:
        client.sendall(b"torque_off\n" if torque_off else b"stop\n")
    except OSError:
        client.close()
        raise
    return client


def confirm(client: socket.socket) -> None:
    """Print the answer of the run, and exit: 0 confirmed, 1 not."""
    from contextlib import suppress

    from retarget.cli.exit import DONE, STOPPED, echo

    answer = b""
    with client:
        client.settimeout(PATIENCE_S)
        with suppress(OSError):
            answer = client.makefile("rb").readline(MAX_LINE)

    text = answer.decode("ascii", errors="replace").strip()
    if not text.startswith("ok"):
        echo(f"error: the run did not confirm it ({text or 'no answer'}): cut the power", err=True)
        raise SystemExit(STOPPED)
    echo(text)
    raise SystemExit(DONE)


def stop(path: str | None = None, torque_off: bool = False) -> None:
    """Stop a live run that has a `--control-socket`: it brakes, goes to its rest posture, and torque goes off.

    Exit code 0: the run confirmed it; 1: it did not; 2: no run listens there.

    Arguments:
        path: Path of the run's socket, as given to `--control-socket`; without it the usual one.

    Options:
        torque_off: Torque off at once, without braking: it may fall.
    """
    from retarget.errors import UsageError

    where = socket_path(path)
    try:
        client = _sent(where, torque_off=torque_off)
    except OSError as error:
        raise UsageError(
            f"no live run listens there: {error.strerror or error}",
            where=str(where),
            next_step="Start the run with --control-socket, and give the same path here; in a hurry cut the power",
        ) from error
    confirm(client)
