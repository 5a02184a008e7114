"""A question to the person at the terminal."""

import sys

import typer

from retarget.errors import UsageError

__all__ = ["ask"]


def ask(question: str, *, enter: bool = True, where: str = "") -> bool:
    """Whether a person agrees: y is yes, n is no, ENTER alone is `enter`. where: the command that asks.

    Raises UsageError where nobody can answer.
    """
    while True:
        typer.echo(f"{question} [{'Y/n' if enter else 'y/N'}] ", nl=False)
        sys.stdout.flush()
        line = sys.stdin.readline()
        if not line:
            typer.echo()
            raise UsageError(
                "nobody answers the question: the input has ended", where=where, next_step="Run it in a terminal"
            )
        answer = line.strip().lower()
        if not answer:
            return enter
        if answer in ("y", "yes"):
            return True
        if answer in ("n", "no"):
            return False
