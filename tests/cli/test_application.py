"""Questions to the operator, options with a usual value, files that are replaced only with --overwrite, typed lines."""

import importlib
import io
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, is_dataclass
from inspect import signature
from pathlib import Path
from typing import Any, Literal

import pytest
import typer
from typer.testing import CliRunner

from command_line import Typed, code_of
from messages import refuses, shows
from recordings import record
from retarget.cli import COMMANDS, HOMES
from retarget.cli.application import command_of, confirmed, described, given, refuse_given, with_values
from retarget.cli.emulate import TypedLines
from retarget.cli.exit import DONE
from retarget.errors import UsageError
from retarget.recording.reading import read_recording
from unknown_robots import small_bust


@pytest.mark.parametrize(
    ("typed", "answer"),
    [
        ("\n", True),
        ("y\n", True),
        (" YES \n", True),
        ("n\n", False),
        ("No\n", False),
        ("maybe\n\n", True),
        ("n", False),
    ],
)
def test_enter_is_yes_and_anything_strange_is_asked_again(
    typed: str, answer: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(typed))
    assert confirmed("Go on?") is answer
    assert capsys.readouterr().out == "Go on? [Y/n] " * max(1, typed.count("\n"))


def test_a_question_without_answer_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    with refuses(UsageError, "servo home: the question has no answer"):
        confirmed("Go on?", where="servo home")
    assert capsys.readouterr().out == "Go on? [Y/n] \n"


@pytest.mark.parametrize(
    ("words", "whole"),
    [
        ("run --realtime --core 1", "run --realtime 40 --core 1"),
        ("run --realtime", "run --realtime 40"),
        ("run --realtime 50 --core 1", "run --realtime 50 --core 1"),
        ("run --control-socket --realtime", "run --control-socket usual --realtime 40"),
        ("run --control-socket here.sock", "run --control-socket here.sock"),
        ("run --realtime=7", "run --realtime=7"),
        ("", ""),
    ],
)
def test_the_usual_value_is_put_in(words: str, whole: str) -> None:
    assert with_values(words.split()) == whole.split()


MINE = b"mine"
RUN = ("run", "--robot", "op3", "--source", "sample", "--end", "0.1")
OUTPUTS = {
    "r.json": ("--report", "r.json"),
    "report.html": ("--report", "."),
    "report.json": ("--report", "."),
    "r.npz": ("--save", "r.npz"),
    "angles.png": ("--plots", "."),
    "r.gif": ("--animate", "r.gif"),
    "r.mcap": ("--record", "r.mcap"),
}
"""Files, and the options by which a run writes them."""


@pytest.mark.parametrize("name", OUTPUTS)
def test_a_run_is_refused_before_it_begins(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: Typed
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(name).write_bytes(MINE)
    shows(refused(*RUN, *OUTPUTS[name]), OUTPUTS[name][0], name, "--overwrite")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {name: MINE}


@pytest.mark.long
def test_all_of_them_are_replaced_where_that_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in OUTPUTS:
        Path(name).write_bytes(MINE)
    words = [word for name, option in OUTPUTS.items() if name != "r.json" for word in option]
    assert code_of(*RUN, *words, "--overwrite") == DONE
    assert [name for name in OUTPUTS if Path(name).read_bytes() == MINE] == ["r.json"]
    assert read_recording(tmp_path / "r.mcap").damage == ""


@pytest.mark.parametrize("command", [pytest.param("replay", marks=pytest.mark.long), "fit-observers"])
def test_what_another_command_writes(command: str, tmp_path: Path, done: Typed, refused: Typed) -> None:
    if command == "replay":
        read, words = record(tmp_path / "run.mcap", seconds=0.1).path, ("--save", tmp_path / "again.npz")
    else:
        read, words = tmp_path / "bust.urdf", ("--out", tmp_path / "observers.yaml")
        read.write_text(small_bust())
    words[1].write_bytes(MINE)
    shows(refused(command, read, *words))
    assert words[1].read_bytes() == MINE
    done(command, read, *words, "--overwrite")
    assert words[1].read_bytes() != MINE


def test_a_recording_that_is_played_is_not_replaced_by_itself(tmp_path: Path, refused: Typed) -> None:
    raw = tmp_path / "a.raw"
    raw.write_bytes(MINE)
    shows(refused("run", "--robot", "op3", "--source", f"replay://{raw}", "--record-raw", raw, "--overwrite"))
    assert raw.read_bytes() == MINE


@pytest.fixture
def pipe(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """The end to write into."""
    out, into = os.pipe()
    with os.fdopen(out) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield into


def test_lines_come_whole(pipe: int) -> None:
    received: list[str] = []
    typed = TypedLines(received.append)
    for piece in (b"miss", b"ing 5\ncle", b"ar\n\xff\n", b"rest"):
        os.write(pipe, piece)
        assert typed.read()
    assert received == ["missing 5", "clear", "\ufffd"]
    os.close(pipe)
    assert not typed.read()
    assert received[3:] == ["rest"]


def test_an_endless_line_costs_no_memory(pipe: int) -> None:
    typed = TypedLines(lambda line: None)
    for _ in range(50):
        os.write(pipe, b"x" * 4096)
        typed.read()
    assert len(typed._pending) <= 4096
    os.close(pipe)


def test_only_a_pipe_or_a_terminal_is_waited_for(pipe: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.close(pipe)
    assert TypedLines.descriptor() is not None
    path = tmp_path / "lines"
    path.write_text("missing 5\n")
    with path.open() as stream:
        monkeypatch.setattr(sys, "stdin", stream)
        assert TypedLines.descriptor() is None
    monkeypatch.setattr(sys, "stdin", None)
    assert TypedLines.descriptor() is None


# From a function and its docstring to a command: options, groups of options, panels, required ones first.


@dataclass(frozen=True)
class Inner:
    """A group in a group."""

    loop: bool = False
    hidden: float = 1.0


@dataclass(frozen=True)
class Group:
    """How it is played.

    Playing:
        speed X: 1 is the performer's speed, and
            more is faster.
        kinds (--kind) a|b: Also several times.
        loop: Again and again.
    """

    speed: float = 1.0
    kinds: tuple[str, ...] = ()
    inner: Inner = field(default_factory=Inner)


CALLED: list[tuple[Any, ...]] = []


def play(group: Group, source: str, parts: Literal["whole", "upper"] = "whole", out: str | None = None) -> None:
    """Play it.

    At once.

    Arguments:
        source FILE: What is played.

    Options:
        parts whole|upper: What follows.
        out (--out, -o) PATH: Where it goes.
    """
    CALLED.append((group, source, parts, out))


def run(*words: str) -> tuple[int, str]:
    """Exit code and output of `play`."""
    application = typer.Typer(rich_markup_mode=None)
    application.command(help=described(play)[0])(command_of(play))
    result = CliRunner().invoke(application, list(words))
    return result.exit_code, result.output


def test_the_help_is_the_docstring() -> None:
    said = run("--help")[1]
    second, field_line, spread = "At once.", "source FILE", "1 is the performer's speed, and more is faster."
    assert second in said and "Arguments:\n  FILE" in said and field_line not in said
    assert spread in " ".join(said.split())
    panels = {name: one.annotation.__metadata__[0].rich_help_panel for name, one in parameters(play).items()}
    assert panels["speed"] == panels["loop"] == "Playing" and panels["parts"] is None
    assert next(iter(panels)) == "source", "the required first"


def test_options_that_are_given() -> None:
    assert given(Group()) == [] and given(Group(2.0, ("a",), Inner(loop=True))) == ["--speed", "--kinds"]
    assert given(Group(2.0, ("a",)), but=("speed",)) == ["--kinds"]
    refuse_given([], "motion file")
    with refuses(UsageError, "--speed, --kinds"):
        refuse_given(["--speed", "--kinds"], "motion file")


def parameters(function: Callable[..., Any]) -> dict[str, Any]:
    """The parameters that typer sees."""
    return dict(signature(command_of(function)).parameters)


def names(holder: Callable[..., Any]) -> Iterator[str]:
    """The parameters of a function and of its groups."""
    for name, one in signature(holder).parameters.items():
        if is_dataclass(one.annotation):
            yield from names(one.annotation)  # type: ignore[arg-type]
        else:
            yield name


@pytest.mark.parametrize("command", [name for name in COMMANDS if name != "servo"])
def test_every_option_is_described_once_and_every_description_is_of_an_option(command: str) -> None:
    usual = command.replace("-", "_")
    file, word = HOMES.get(command, (usual, usual))
    function = getattr(importlib.import_module(f"retarget.cli.{file}"), word)
    known, shown = list(names(function)), parameters(function)
    assert len(set(known)) == len(known)
    assert set(described(function)[1]) <= set(shown), "described, and no option"
    assert set(signature(function).parameters) & set(known) <= set(shown), "a parameter that is not described"
