"""From a function and its docstring to a command: options, groups of options, panels, required ones first."""

import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, is_dataclass
from inspect import signature
from typing import Any, Literal

import pytest
import typer
from typer.testing import CliRunner

from messages import refuses
from retarget.cli import COMMANDS, HOMES
from retarget.cli.application import command_of, described, given, refuse_given
from retarget.errors import UsageError


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


def test_a_switch_is_undone_by_its_opposite() -> None:
    assert run("a.bvh", "--loop", "--no-loop")[0] == 0 and CALLED.pop()[0] == Group()


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
