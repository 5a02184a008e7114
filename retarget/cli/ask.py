"""A question to the person at the terminal."""

import sys

import typer

from retarget.errors import UsageError

__all__ = ["ask"]


def ask(question: str) -> bool:
    """Whether a person agrees: ENTER or y; n is no. Raises UsageError where nobody can answer."""
    while True:
        typer.echo(f"{question} [Y/n] ", nl=False)
        sys.stdout.flush()
        line = sys.stdin.readline()
        if not line:
            raise UsageError("nobody answers: the input has ended", found=question, next_step="Run this in a terminal")
        answer = line.strip().lower()
        if answer in ("", "y", "yes"):
            return True
        if answer in ("n", "no"):
            return False
