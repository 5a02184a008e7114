"""The commands as typer knows them: their words, their help, and the exit codes."""

import importlib
from collections.abc import Callable
from typing import Annotated, Any

import typer

import retarget
from retarget.cli import COMMANDS

__all__ = ["application"]

EPILOG = (
    "Exit codes: 0 done, 1 stopped by the guard or by Ctrl-C while something moved, or a file not written afterwards, "
    "2 refused before anything moved, 3 a defect of ours, 130 Ctrl-C before anything moved."
)


def application(chosen: str | None) -> typer.Typer:
    """The application in which only the `chosen` command is real; the others lend their name and line to the help."""
    known = typer.Typer(
        add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None, epilog=EPILOG
    )
    known.callback(invoke_without_command=True)(_options)
    for name, summary in COMMANDS.items():
        if name == chosen:
            known.command(name)(_load(name))
        else:
            known.command(name, help=summary)(_not_chosen)
    return known


def _load(name: str) -> Callable[..., Any]:
    """Import a command's file and return its function."""
    word = name.replace("-", "_")
    function: Callable[..., Any] = getattr(importlib.import_module(f"retarget.cli.{word}"), word)
    return function


def _not_chosen() -> None:
    raise AssertionError("only the chosen command is ever called")


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"retarget {retarget.__version__}")
        raise typer.Exit


def _options(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and leave.", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    """From a performer's sensors to safe servo goals."""
