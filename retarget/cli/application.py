"""The commands as typer knows them, and what they share: options, questions, progress, tables."""

import importlib
import inspect
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import wraps
from itertools import pairwise
from pathlib import Path
from types import NoneType
from typing import IO, TYPE_CHECKING, Annotated, Any, Literal, cast, get_args, get_origin

import typer
from typer.core import TyperCommand

import retarget
from hardware.errors import printable
from hardware.realtime import USUAL_PRIORITY
from retarget.cli.exit import echo
from retarget.cli.stop import USUAL
from retarget.errors import UsageError, renamed_to, suggest
from retarget.live.address import VIEW_PORT

if TYPE_CHECKING:
    from rich.console import Console

    from retarget.frames import SensorFrames

EPILOG = (
    "Exit codes: 0 done, 1 stopped by the guard or by Ctrl-C while something moved, or a file not written afterwards, "
    "2 refused before anything moved, 3 a defect of ours, 130 Ctrl-C before anything moved. "
    "SIGTERM, SIGHUP and SIGQUIT are as Ctrl-C."
)


UNWRAPPED = 10_000
"""Columns of a pipe or file: lines are wrapped for terminals alone."""
WIDEST = 100
"""Most columns of the help on a terminal."""


HELP_ALL = "--help-all"
"""In place of `--help`: every option of a command that has many."""


def application(chosen: Sequence[str], *, all_options: bool = False) -> typer.Typer:
    """The application in which only the command of the words `chosen` is real (a group's: the group and its command);
    the others lend their name and line to the help. all_options: the help of a command lists every one."""
    known = _commands("retarget.cli", chosen, epilog=EPILOG, all_options=all_options)
    known.callback(invoke_without_command=True)(_options)
    return known


def called(commands: typer.Typer, words: Sequence[str], name: str = "retarget") -> int:
    """Call the command that the words name. Returns its exit code; raises UsageError for words that mean none.

    name: of the program, in messages.
    """
    try:
        code = commands(args=list(words), prog_name=name, standalone_mode=False)
    except typer.TyperException as error:
        return _refused_words(error)
    return code if isinstance(code, int) else 0


def _refused_words(error: typer.TyperException) -> int:
    """Print the help, where no words were given, and return the exit code. Raises UsageError for the words."""
    context, text = getattr(error, "ctx", None), getattr(error, "message", "") or "needed, and not given"
    from pydantic import ValidationError

    from retarget.schema.strict_models import expected_by

    if context is not None and text == context.get_help():
        echo(text, err=True)
        return 2
    where, parameter = getattr(error, "option_name", ""), getattr(error, "param", None)
    if where:
        text = re.sub(f":? '?{re.escape(where)}'?", "", text)
    elif parameter is not None:
        where = parameter.opts[-1] if parameter.param_type_name == "option" else parameter.metavar or parameter.name
    what, path, step = text[:1].lower() + text[1:].partition(". ")[0].removesuffix("."), "retarget", ""
    found = allowed = ""
    if isinstance(error.__cause__, ValidationError):  # of the value of an option
        detail = error.__cause__.errors(include_url=False)[0]
        what = detail["msg"].removeprefix("Value error, ").removesuffix(".")
        if allowed := expected_by(detail["msg"]):
            what, found = "wrong value", repr(detail["input"])[:80]
    if context is not None:
        path = context.command_path
        known = [name for one in context.command.get_params(context) for name in (*one.opts, *one.secondary_opts)]
        if what.startswith("no such"):
            step = suggest(where or what.split("'")[1], [*known, *getattr(context.command, "commands", ())])
        step = step or f"See `{path} --help`"
    raise UsageError(what, where=where or path, found=found, allowed=allowed, next_step=step)


class _Command(TyperCommand):
    """A command whose help has a panel for each group of options; or, where it has USUAL_OPTIONS, these alone."""

    USUAL_OPTIONS: Sequence[str] = ()

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the words. Raises UsageError where an option takes another one for its value."""
        take = {name for one in self.get_params(ctx) if not getattr(one, "is_flag", True) for name in one.opts}
        for word, after in pairwise(args[: args.index("--")] if "--" in args else args):
            if word in take and re.match("--[a-z]", after):
                raise UsageError("needs a value", where=word, found=after, next_step=f"See `{ctx.command_path} --help`")
        return super().parse_args(ctx, args)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        panels: dict[str, list[tuple[str, str]]] = {"Arguments": []}
        for parameter in self.get_params(ctx):
            usual = "Arguments" if parameter.param_type_name == "argument" else "Options"
            heading = getattr(parameter, "rich_help_panel", None) or usual
            if self.USUAL_OPTIONS:
                if parameter.opts[0] not in self.USUAL_OPTIONS:
                    continue
                heading = "Options"
            panel = panels.setdefault(heading, [])
            names, text = parameter.get_help_record(ctx) or ("", "")
            usual_first = names.partition(" / ")[0] if parameter.default is False else names
            panel += [(usual_first, _RANGE.sub("", text))] * bool(names)
        for heading, records in panels.items():
            if not records:
                continue
            with formatter.section(heading):
                formatter.write_dl(records, col_max=FIRST_COLUMN)
        if self.USUAL_OPTIONS:
            formatter.write_text(f"more: {HELP_ALL}")


_RANGE = re.compile(r" *\[[^\]]*<=x<=[^\]]*\]")
"""What typer says of the range of a number: a value outside of it is refused with the same words."""
FIRST_COLUMN = 24
"""Columns of an option and its value in the help; the meaning of a longer one begins in the next line."""


def _commands(
    package: str, chosen: Sequence[str], *, epilog: str | None = None, all_options: bool = False
) -> typer.Typer:
    """The commands of a package; its `COMMANDS` names them. A module's USUAL_OPTIONS are those of its help, unless all
    are asked for."""
    width = {"max_content_width": WIDEST} if sys.stdout.isatty() else {"terminal_width": UNWRAPPED}
    group = typer.Typer(
        add_completion=False,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        epilog=epilog,
        context_settings=width,
    )
    listing = importlib.import_module(package)
    for name, summary in listing.COMMANDS.items():
        if name not in chosen[:1]:
            group.command(name, help=summary)(_not_chosen)
            continue
        usual = name.replace("-", "_")
        file, word = getattr(listing, "HOMES", {}).get(name, (usual, usual))
        module = importlib.import_module(f"{package}.{file}")
        function: Callable[..., Any] = getattr(module, word)
        if hasattr(module, "COMMANDS"):
            inner = _commands(module.__name__, chosen[1:])
            inner.callback()(function)
            group.add_typer(inner, name=name)
        else:
            usual_options = () if all_options else getattr(module, "USUAL_OPTIONS", ())
            kind = type("Command", (_Command,), {"USUAL_OPTIONS": usual_options})
            group.command(name, cls=kind, help=described(function)[0])(command_of(function))
    return group


def _not_chosen() -> None:
    raise AssertionError("only the chosen command is ever called")


def _show_version(wanted: bool) -> None:
    if wanted:
        echo(f"retarget {retarget.__version__}")
        raise typer.Exit


def _options(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and leave.", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    """From a performer's sensors to safe servo goals."""


# Options that may stand alone or with a value: typer knows only the second, so the usual value is put in here.

USUAL_VALUES = {"--realtime": str(USUAL_PRIORITY), "--control-socket": USUAL, "--view": str(VIEW_PORT)}


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


ONCE = {"batch": "--format", "export": "--to"}
"""Command -> its option that chooses what it makes."""


def refuse_repeated(words: Sequence[str]) -> None:
    """Raises UsageError for several formats: the last one alone would be made."""
    option = ONCE.get(next((word for word in words if not word.startswith("-")), ""), "")
    if option and sum(word.partition("=")[0] == option for word in words) > 1:
        step = "Give the command once for each: outputs of several formats go beside each other"
        raise UsageError("several formats", where=option, allowed="one", next_step=step)


# From a function to a command: its parameters are the options, and its docstring says what they mean:
#
#     Options:
#         robot NAME|PATH: Robot by name or path.
#         iterations (--n-ik) N: Iterations per frame at most.
#
# `Arguments:` describes arguments, and any other heading is that of a panel of the help. A parameter may be a
# dataclass, which is a group of options: those of its fields that are described, there or by what takes it. A parameter
# that typer annotates is passed on as it is.

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
        if (found := _HEADING.fullmatch(line)) and found[1] != "Examples":
            heading = found[1]
        elif not heading:
            text += ["\b"] * bool(found)  # for typer: what follows is not wrapped
            text.append(line)
        elif found := _ENTRY.fullmatch(line):
            name, flags, metavar, words = found.groups()
            entries[name] = _Entry(heading, tuple(flags.split(", ")) if flags else (), metavar, words)
        elif line:
            entries[name] = replace(entries[name], help=f"{entries[name].help} {line.strip()}")
    return "\n".join(text).strip(), entries


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
    if kind is bool and parameter.default is False and not flags:
        name = parameter.name.replace("_", "-")
        flags = (f"--{name}/--{name.removeprefix('no-') if name.startswith('no-') else f'no-{name}'}",)
    if entry.heading == "Arguments":
        info = typer.Argument(help=entry.help, metavar=entry.metavar, show_default=parameter.default is not None)
    else:
        panel = None if entry.heading == "Options" else entry.heading
        shown = parameter.default is not None and parameter.default is not False
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


# Options that several commands have.

Overwrite = Annotated[
    bool,
    typer.Option(
        "--overwrite/--no-overwrite",
        help="Replace files that are there; else they are refused.",
        rich_help_panel="Results",
        show_default=False,
    ),
]
"""`--overwrite`: the one way in which a command replaces a file that is there."""


@dataclass(frozen=True, kw_only=True)
class FileOptions:
    """How a motion file is read.

    Playback:
        skeleton FILE.asf: The ASF of an AMC that has none beside it.
        markers FILE.yaml: Which markers of a C3D or TRC are which sensor.
        unit m|cm|mm|inch|cmu: Length unit of a file that states none.
        rate HZ: Frames per second instead of the file's.
        stature M: The performer's: scales a file, not measured live.
        up AXIS: Up axis of the file: x, y, z, -x, -y or -z.
        performer_root NAME: One ROOT of a BVH that has several.
    """

    skeleton: Path | None = None
    markers: Path | None = None
    unit: str | None = None
    rate: float | None = None
    stature: float | None = None
    up: str | None = None
    performer_root: str | None = None

    def open(self, source: str) -> "SensorFrames":
        """Read a motion file. Raises RetargetError."""
        from retarget.sources.open import open_source

        return open_source(source, **vars(self))


def given(group: Any, *, but: Sequence[str] = ()) -> list[str]:
    """The options of a group (a dataclass) that are not at their defaults, as typed. but: fields that do not count."""
    counted = [field for field in fields(group) if field.name not in but and not is_dataclass(field.type)]
    changed = [field.name for field in counted if getattr(group, field.name) != field.default]
    return [f"--{name.replace('_', '-')}" for name in changed]


def refuse_given(options: Sequence[str], whose: str) -> None:
    """Raise UsageError for options that only a source of another kind has."""
    if options:
        raise UsageError(f"only a {whose} has this", where=", ".join(options), next_step="Leave it out")


# What is said to the operator: on stderr, so that a pipe gets results alone.


def log(text: str) -> None:
    """Print a line for the operator that says what happens."""
    echo(text, err=True)


def note(text: str) -> None:
    """Say what the operator should know."""
    log(f"note: {text}")


def console(*, err: bool = False) -> "Console":
    """Make the console on which tables and progress are printed, on stdout or stderr. In a pipe it wraps no line. What
    acts on a terminal in the texts that it is given is spelled out, as `echo` does."""
    from rich.console import Console, ConsoleOptions, RenderableType
    from rich.segment import Segment

    class PlainConsole(Console):
        """A console whose own control codes alone reach the terminal."""

        def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterator[Segment]:
            for text, style, control in super().render(renderable, options):
                yield Segment(text if control else printable(text), style, control)

    stream = sys.stderr if err else sys.stdout
    if stream.isatty():
        return PlainConsole(stderr=err)
    return PlainConsole(file=cast(IO[str], Unpadded(stream)), width=UNWRAPPED)


class Unpadded:
    """A stream that gets lines without the blanks at their ends, with which tables fill their columns."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write whole lines."""
        return self._stream.write(re.sub(r" +(?=\n)", "", text))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


# A question to the operator at the terminal.


def ask(question: str, *, enter: bool = True, where: str = "") -> bool:
    """Ask the operator: y is yes, n is no, ENTER alone is `enter`. where: the command that asks.

    Raises UsageError when the input has ended.
    """
    answers = {"": enter, "y": True, "yes": True, "n": False, "no": False}
    while True:
        answer = answers.get(answered(f"{question} [{'Y/n' if enter else 'y/N'}] ", where=where).lower())
        if answer is not None:
            return answer


def answered(question: str, *, where: str = "", step: str = "Run it in a terminal") -> str:
    """What the operator types in answer. Raises UsageError, with this next step, when the input has ended."""
    try:
        return input(printable(question)).strip()
    except EOFError as error:
        echo()
        raise UsageError("the question has no answer: the input has ended", where=where, next_step=step) from error


# A line about what goes on, on a terminal (stderr), and nothing in a pipe.


@contextmanager
def progress_bar(what: str, total: int | None) -> Iterator[Callable[[int], None]]:
    """Yields a function that takes how much is done of `total` (None: not known)."""
    if not sys.stderr.isatty():
        yield lambda done: None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    percentage = TextColumn("{task.percentage:3.0f} %")
    columns = (TextColumn("{task.description}"), BarColumn(), percentage, TimeRemainingColumn())
    with Progress(*columns, console=console(err=True), transient=True) as bar:
        task = bar.add_task(what, total=total)
        yield lambda done: bar.update(task, completed=done)
        bar.update(task, completed=total)
