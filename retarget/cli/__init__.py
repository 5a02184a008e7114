"""The command line: one file per command, each with a function of the command's name.

Only the command that is asked for is imported, so that `--help` and `--version` answer at once.
"""

import atexit
import gc
import importlib
import os
import sys
from collections.abc import Callable, Sequence
from typing import Annotated, Any

import typer

import retarget
from retarget.cli.boundary import exit_code_of

COMMANDS = {
    "demo": "See it work: no data and no hardware needed.",
    "run": "Let a robot follow a recorded performer.",
    "inspect": "Say what is in a motion file.",
    "check": "Validate profiles, priorities and performers.",
    "robots": "List the robots known by name.",
}
"""Every command and its line in the list of commands."""

EPILOG = (
    "Exit codes: 0 done, 1 stopped by the guard or interrupted, 2 refused before anything moved, 3 a defect of ours."
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line with `arguments` (those of the process by default) and leave with its exit code."""
    words = sys.argv[1:] if arguments is None else list(arguments)
    chosen = next((word for word in words if not word.startswith("-")), None)
    if arguments is None:
        _make_haste()
    sys.exit(exit_code_of(lambda: _application(chosen)(args=words, prog_name="retarget")))


def _make_haste() -> None:
    """In a process of our own: nobody collects garbage (0.1 s), loads the windows of MuJoCo (40 ms), seeks plugins of
    pydantic, or keeps a second core spinning for matrices as small as ours (0.1 s)."""
    gc.disable()
    atexit.register(gc.freeze)
    for name, value in (
        ("MUJOCO_GL", "disable"),
        ("PYDANTIC_DISABLE_PLUGINS", "__all__"),
        ("OPENBLAS_NUM_THREADS", "1"),
    ):
        os.environ.setdefault(name, value)


def _application(chosen: str | None) -> typer.Typer:
    """The application in which only the `chosen` command is real; the others lend their name and line to the help."""
    application = typer.Typer(
        add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None, epilog=EPILOG
    )
    application.callback(invoke_without_command=True)(_options)
    for name, summary in COMMANDS.items():
        if name == chosen:
            application.command(name)(_load(name))
        else:
            application.command(name, help=summary)(_not_chosen)
    return application


def _load(name: str) -> Callable[..., Any]:
    """Import a command's file and return its function."""
    function: Callable[..., Any] = getattr(importlib.import_module(f"retarget.cli.{name}"), name)
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
