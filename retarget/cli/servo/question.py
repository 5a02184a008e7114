"""A question before something is written or goes limp: only a clear yes is one."""

import sys

import typer

from retarget.errors import UsageError


def agreed(question: str, *, yes: bool) -> bool:
    """Whether a person agrees, or did beforehand (`yes`); ENTER alone is no. Raises UsageError where nobody can
    answer."""
    if yes:
        return True
    typer.echo(f"{question} [y/N] ", nl=False)
    sys.stdout.flush()
    line = sys.stdin.readline()
    if not line:
        typer.echo()
        raise UsageError(
            "nobody answers: the input has ended", where="servo", next_step="Run it in a terminal, or agree with --yes"
        )
    if line.strip().lower() in ("y", "yes"):
        return True
    typer.echo("nothing was done")
    return False
