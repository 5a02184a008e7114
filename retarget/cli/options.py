"""From a function to a command: its parameters are the options, and its docstring says what they mean:

    Options:
        robot NAME|PATH: Robot by name or path.
        iterations (--n-ik) N: Iterations per frame at most.

`Arguments:` describes arguments, and any other heading is that of a panel of the help. A parameter may be a dataclass,
which is a group of options: those of its fields that are described, there or by what takes it. A parameter that typer
annotates is passed on as it is.
"""

import inspect
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import wraps
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args, get_origin

import typer

from retarget.errors import UsageError

if TYPE_CHECKING:
    from retarget.frames import SensorFrames

Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace files that are there; else they are refused.")]
"""`--overwrite`: the one way in which a command replaces a file that is there."""


@dataclass(frozen=True, kw_only=True)
class FileOptions:
    """How a motion file is read.

    Options:
        skeleton FILE.asf: The ASF of an AMC, where it does not lie beside it.
        unit m|cm|mm|inch|cmu: Length unit of the file, where it states none.
        rate HZ: Frames per second instead of the file's.
    """

    skeleton: Path | None = None
    unit: str | None = None
    rate: float | None = None

    def open(self, source: str) -> "SensorFrames":
        """Read a motion file. Raises RetargetError."""
        from retarget.sources.open import open_source

        return open_source(source, skeleton=self.skeleton, unit=self.unit, rate=self.rate)


def given(group: Any, *, but: Sequence[str] = ()) -> list[str]:
    """The options of a group (a dataclass) that are not at their defaults, as typed. but: fields that do not count."""
    counted = [field for field in fields(group) if field.name not in but and not is_dataclass(field.type)]
    changed = [field.name for field in counted if getattr(group, field.name) != field.default]
    return [f"--{name.replace('_', '-')}" for name in changed]


def refuse_given(options: Sequence[str], whose: str) -> None:
    """Raise UsageError for options that only a source of another kind has."""
    if options:
        raise UsageError(f"only a {whose} has this", where=", ".join(options), next_step="Leave it out")


# What a docstring says.

_HEADING = re.compile(r"([A-Z][\w ]*):")
_ENTRY = re.compile(r"    (\w+)(?: \((.+?)\))?(?: (\S+))?: (.+)")


@dataclass(frozen=True)
class _Entry:
    """What a docstring says of one option. flags: as typed, where they are not its name with dashes."""

    heading: str
    flags: tuple[str, ...]
    metavar: str | None
    help: str


def described(holder: Callable[..., Any]) -> tuple[str, dict[str, _Entry]]:
    """The docstring of a function or dataclass without its options, and these by name."""
    text: list[str] = []
    entries: dict[str, _Entry] = {}
    heading = name = ""
    for line in (inspect.getdoc(holder) or "").splitlines():
        if found := _HEADING.fullmatch(line):
            heading = found[1]
        elif not heading:
            text.append(line)
        elif found := _ENTRY.fullmatch(line):
            name, flags, metavar, words = found.groups()
            entries[name] = _Entry(heading, tuple(flags.split(", ")) if flags else (), metavar, words)
        elif line:
            entries[name] = replace(entries[name], help=f"{entries[name].help} {line.strip()}")
    return "\n".join(text).strip(), entries


# The command that typer reads.


def command_of(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function whose signature typer can read, and that calls `function` with its groups built."""

    @wraps(function)
    def command(**values: Any) -> Any:
        return _built(function, values)

    parameters = sorted(_parameters(function, {}), key=lambda one: one.default is not one.empty)  # the required first
    command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return command


def _parameters(holder: Callable[..., Any], known: Mapping[str, _Entry]) -> Iterator[inspect.Parameter]:
    """The options of a function or group. known: what is said of them by what takes the group."""
    known = {**described(holder)[1], **known}
    for parameter in inspect.signature(holder).parameters.values():
        if is_dataclass(parameter.annotation):
            yield from _parameters(parameter.annotation, known)  # type: ignore[arg-type]
        elif get_origin(parameter.annotation) is Annotated:
            yield parameter.replace(kind=parameter.KEYWORD_ONLY)
        elif parameter.name in known:
            yield _parameter(parameter, known[parameter.name])


def _parameter(parameter: inspect.Parameter, entry: _Entry) -> inspect.Parameter:
    kind, flags = parameter.annotation, entry.flags
    if kind is bool and parameter.default is False:
        flags = flags or (f"--{parameter.name.replace('_', '-')}",)  # without its opposite, which typer would add
    if entry.heading == "Arguments":
        info = typer.Argument(help=entry.help, metavar=entry.metavar, show_default=parameter.default is not None)
    else:
        panel = None if entry.heading == "Options" else entry.heading
        shown = parameter.default is not None
        info = typer.Option(*flags, help=entry.help, metavar=entry.metavar, rich_help_panel=panel, show_default=shown)
    return parameter.replace(kind=parameter.KEYWORD_ONLY, annotation=Annotated[_typed(kind), info])


def _typed(kind: Any) -> Any:
    """The type that typer reads: what takes a choice also checks it, and names the nearest."""
    parts = get_args(kind) or (kind,)
    if get_origin(kind) is tuple:
        return list[parts[0]]  # type: ignore[valid-type]
    if get_origin(kind) is Literal or any(get_origin(part) is Literal for part in parts):
        return str | None if NoneType in parts else str
    return kind


def _built(holder: Callable[..., Any], values: Mapping[str, Any]) -> Any:
    """Call a function or dataclass with the values of its options."""
    arguments = {}
    for name, parameter in inspect.signature(holder).parameters.items():
        kind = parameter.annotation
        if is_dataclass(kind):
            arguments[name] = _built(kind, values)  # type: ignore[arg-type]
        elif name in values:
            arguments[name] = tuple(values[name]) if get_origin(kind) is tuple else values[name]
    return holder(**arguments)
