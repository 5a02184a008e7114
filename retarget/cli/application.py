"""The commands as typer knows them, and what they share: usual values of options, questions, progress, typed lines."""

import importlib
import os
import stat
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Annotated, Any

import typer

import retarget
from hardware.realtime import USUAL_PRIORITY
from retarget.cli.options import command_of, described
from retarget.errors import UsageError, renamed_to
from retarget.run.control_socket import USUAL
from retarget.viewer.server import PORT

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
            group.command(name, help=described(function)[0])(command_of(function))
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


# Options that may stand alone or with a value: typer knows only the second, so the usual value is put in here.

USUAL_VALUES = {"--realtime": str(USUAL_PRIORITY), "--control-socket": USUAL, "--view": str(PORT)}


def with_values(words: Sequence[str]) -> list[str]:
    """The words of a command line, with a value behind each of these options that has none."""
    found: list[str] = []
    for word, after in pairwise((*words, "-")):
        found.append(word)
        if word in USUAL_VALUES and after.startswith("-"):
            found.append(USUAL_VALUES[word])
    return found


def refuse_renamed(words: Sequence[str]) -> None:
    """Raises UsageError for an option that has another name now."""
    command = next((word for word in words if not word.startswith("-")), "")
    for word in words:
        option = word.partition("=")[0]
        if step := renamed_to(f"{command} {option}"):
            raise UsageError("no such option", where=option, next_step=step)


# What is said to the operator: on stderr, so that a pipe gets results alone.


def log(text: str) -> None:
    """Say what happens."""
    typer.echo(text, err=True)


def note(text: str) -> None:
    """Say what the operator should know."""
    log(f"note: {text}")


# A question to the operator at the terminal.


def ask(question: str, *, enter: bool = True, where: str = "") -> bool:
    """Ask the operator: y is yes, n is no, ENTER alone is `enter`. where: the command that asks.

    Raises UsageError when the input has ended.
    """
    answers = {"": enter, "y": True, "yes": True, "n": False, "no": False}
    while True:
        try:
            answer = answers.get(input(f"{question} [{'Y/n' if enter else 'y/N'}] ").strip().lower())
        except EOFError as error:
            typer.echo()
            raise UsageError(
                "the question has no answer: the input has ended", where=where, next_step="Run it in a terminal"
            ) from error
        if answer is not None:
            return answer


# A line about what goes on, on a terminal (stderr), and nothing in a pipe.


@contextmanager
def progress_bar(what: str, total: int | None) -> Iterator[Callable[[int], None]]:
    """Yields a function that takes how much is done of `total` (None: not known)."""
    if not sys.stderr.isatty():
        yield lambda done: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    percentage = TextColumn("{task.percentage:3.0f} %")
    columns = (TextColumn("{task.description}"), BarColumn(), percentage, TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=total)
        yield lambda done: bar.update(task, completed=done)


# Lines that are typed, or written by another program, while a command waits for other things too.

MAX_LINE = 4096
"""Longest line that is kept, bytes; a longer one is cut there."""


class TypedLines:
    """Passes whole lines of the standard input to `obey` as they come. Only a terminal in the foreground, or a pipe, is
    read: reading would stop a background process."""

    def __init__(self, obey: Callable[[str], None]) -> None:
        self._obey = obey
        self._pending = b""

    @staticmethod
    def descriptor() -> int | None:
        """The descriptor to wait on; None where there is no input."""
        try:
            fd = sys.stdin.fileno()
            is_pipe = stat.S_ISFIFO(os.fstat(fd).st_mode)
            in_front = os.isatty(fd) and os.tcgetpgrp(fd) == os.getpgrp()
        except (AttributeError, OSError, ValueError):
            return None
        return fd if is_pipe or in_front else None

    def read(self) -> bool:
        """Take what is there; False at the end of the input."""
        fd = self.descriptor()
        try:
            data = b"" if fd is None else os.read(fd, MAX_LINE)
        except OSError:
            return False
        *lines, rest = (self._pending + data).split(b"\n")
        self._pending = rest[:MAX_LINE]
        if not data and rest:
            lines, self._pending = [rest], b""
        for line in lines:
            self._obey(line.decode(errors="replace"))
        return bool(data)
