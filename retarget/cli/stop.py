"""`retarget stop`: stop a live run through its `--control-socket`."""

from contextlib import suppress

import typer

from retarget.cli.controls import MAX_LINE, connect_to, socket_path
from retarget.cli.exit import DONE, STOPPED
from retarget.errors import UsageError

PATIENCE_S = 2.0
"""Most time, s, to wait for the answer of a run, which reads its socket in every tick."""


def stop(path: str | None = None, torque_off: bool = False) -> None:
    """Stop a live run that has a `--control-socket`: it brakes, goes to its rest posture, and torque goes off.

    Exit code 0: the run confirmed it; 1: it did not; 2: no run listens there.

    Arguments:
        path: Of the run's socket, as given to `--control-socket`; without it the usual one.

    Options:
        torque_off: Torque off at once, without braking: it may fall.
    """
    where = socket_path(path)
    try:
        client = connect_to(where)
    except OSError as error:
        raise UsageError(
            f"no live run listens there: {error.strerror or error}",
            where=str(where),
            next_step="Start the run with --control-socket, and give the same path here; in a hurry cut the power",
        ) from error
    answer = b""
    with client:
        client.settimeout(PATIENCE_S)
        with suppress(OSError):
            client.sendall(b"torque_off\n" if torque_off else b"stop\n")
            answer = client.makefile("rb").readline(MAX_LINE)
    text = answer.decode("ascii", errors="replace").strip()
    if not text.startswith("ok"):
        typer.echo(f"error: the run did not confirm it ({text or 'no answer'}): cut the power", err=True)
        raise typer.Exit(STOPPED)
    typer.echo(text)
    raise typer.Exit(DONE)
