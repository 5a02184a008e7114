"""The commands as typer knows them: their words, their help, and the exit codes."""

import importlib
from collections.abc import Callable, Sequence
from typing import Annotated, Any

import typer

import retarget

__all__ = ["application"]

EPILOG = (
    "Exit codes: 0 done, 1 stopped by the guard or by Ctrl-C while something moved, or a file not written afterwards, "
    "2 refused before anything moved, 3 a defect of ours, 130 Ctrl-C before anything moved. "
    "SIGTERM, SIGHUP and SIGQUIT are as Ctrl-C."
)


def application(chosen: Sequence[str], *, panels: bool = False) -> typer.Typer:
    """The application in which only the command of the words `chosen` is real (a group's: the group and its command);
    the others lend their name and line to the help. panels: whether help has headings; they cost time."""
    known = _commands("retarget.cli", chosen, epilog=EPILOG, panels=panels)
    known.callback(invoke_without_command=True)(_options)
    return known


def _commands(package: str, chosen: Sequence[str], *, epilog: str | None = None, panels: bool = False) -> typer.Typer:
    """The commands of a package; its `COMMANDS` names them."""
    group = typer.Typer(
        add_completion=False,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode="rich" if panels else None,
        epilog=epilog,
    )
    listing = importlib.import_module(package)
    for name, summary in listing.COMMANDS.items():
        if name not in chosen[:1]:
            group.command(name, help=summary)(_not_chosen)
            continue
        word = getattr(listing, "FILES", {}).get(name, name.replace("-", "_"))
        module = importlib.import_module(f"{package}.{word}")
        function: Callable[..., Any] = getattr(module, word)
        if hasattr(module, "COMMANDS"):
            inner = _commands(module.__name__, chosen[1:])
            inner.callback()(function)
            group.add_typer(inner, name=name)
        else:
            group.command(name)(function)
    return group


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
