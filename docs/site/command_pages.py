"""The command line as a page, from the commands as typer knows them: what `retarget COMMAND --help` says."""

import importlib
from collections.abc import Iterator
from enum import Enum
from typing import Any

from typer.main import get_command

from retarget.cli import COMMANDS
from retarget.cli.application import EPILOG, application


def commands() -> Iterator[tuple[str, Any]]:
    """Every command and every command of a group: its words, and the command."""
    for name in COMMANDS:
        command = get_command(application([name])).commands[name]  # type: ignore[attr-defined]
        yield name, command
        if not hasattr(command, "commands"):
            continue
        for inner in importlib.import_module(f"retarget.cli.{name}").COMMANDS:
            group = get_command(application([name, inner])).commands[name]  # type: ignore[attr-defined]
            yield f"{name} {inner}", group.commands[inner]


def command_page() -> str:
    """All of them, in Markdown."""
    lines = ["# Command line", "", "Made from `retarget COMMAND --help`.", "", EPILOG, ""]
    lines += ["| command | |", "|---|---|"]
    lines += [f"| [`{name}`](#retarget-{name}) | {_cell(summary)} |" for name, summary in COMMANDS.items()]
    for words, command in commands():
        lines += ["", *_section(words, command)]
    return "\n".join([*lines, ""])


def _section(words: str, command: Any) -> Iterator[str]:
    yield f"{'###' if ' ' in words else '##'} retarget {words}"
    yield ""
    yield (command.help or "").replace("\b\n", "").strip()
    yield ""
    arguments = [one for one in command.params if one.param_type_name == "argument"]
    options = [one for one in command.params if one.param_type_name == "option" and one.name != "help"]
    yield "    " + " ".join(["retarget", words, *(_usage(one) for one in arguments), *_required(options)])
    yield ""
    headings = dict.fromkeys(getattr(one, "rich_help_panel", None) for one in (*arguments, *options))
    for heading in headings:
        rows = [one for one in (*arguments, *options) if getattr(one, "rich_help_panel", None) == heading]
        yield f"| {heading or 'option'} | meaning | usually |"
        yield "|---|---|---|"
        for one in rows:
            yield f"| {_cell(_name(one))} | {_cell(one.help or '')} | {_cell(_usual(one))} |"
        yield ""


def _usage(argument: Any) -> str:
    name = argument.metavar or argument.name.upper()
    shown = f"{name}..." if argument.nargs == -1 and "..." not in name else str(name)
    return shown if argument.required else f"[{shown}]"


def _required(options: list[Any]) -> list[str]:
    needed = [f"{one.opts[0]} {one.metavar}" for one in options if one.required]
    return [*needed, "[OPTIONS]"] if len(options) > len(needed) else needed


def _name(one: Any) -> str:
    if one.param_type_name == "argument":
        return f"`{_usage(one)}`"
    kind = "N" if isinstance(one.default, int | float) else "TEXT"
    if isinstance(one.default, Enum):
        kind = "|".join(str(choice.value) for choice in type(one.default))
    value = "" if getattr(one, "is_flag", False) else f" {one.metavar or kind}"
    return ", ".join(f"`{name}{value}`" for name in (*one.opts, *one.secondary_opts))


def _usual(one: Any) -> str:
    if one.required:
        return "**required**"
    value = one.default
    if value is None or value is False or value in ((), [], "") or callable(value):
        return ""
    return f"`{value.value if isinstance(value, Enum) else value}`"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
