"""The commands as typer commands: the table of options, session files, messages, questions, tables, progress."""

import importlib
import inspect
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import partial, wraps
from itertools import pairwise
from pathlib import Path
from types import NoneType
from typing import IO, TYPE_CHECKING, Annotated, Any, Literal, cast, get_args, get_origin

import typer
from typer.core import TyperCommand
from typer.models import OptionInfo

import retarget
from hardware.errors import printable
from hardware.realtime import USUAL_PRIORITY
from retarget.cli.exit import echo
from retarget.cli.stop import USUAL
from retarget.errors import ConfigError, RefusedError, UsageError, renamed_to, suggest
from retarget.live.address import VIEW_PORT, is_address

if TYPE_CHECKING:
    from rich.console import Console

    from retarget.frames import SensorFrames
    from retarget.schema.strict_yaml import Document

EPILOG = (
    "Exit codes: 0 done, 1 stopped by the guard or by Ctrl-C while something moved, or a file not written afterwards, "
    "2 refused before anything moved, 3 a defect of ours, 130 Ctrl-C before anything moved. "
    "SIGTERM, SIGHUP and SIGQUIT are as Ctrl-C."
)


UNWRAPPED = 10_000
"""Columns of a pipe or file, where no line is wrapped."""
WIDEST = 100
"""Most columns of the help on a terminal."""


HELP_ALL = "--help-all"
"""Lists every option of a command of which `--help` lists the usual ones."""


def application(chosen: Sequence[str], *, all_options: bool = False) -> typer.Typer:
    """The application, in which only the command that the words `chosen` name is imported. all_options: its help lists
    every option."""
    known = _commands("retarget.cli", chosen, epilog=EPILOG, all_options=all_options)
    known.callback(invoke_without_command=True)(_options)
    return known


def called(commands: typer.Typer, words: Sequence[str], name: str = "retarget") -> int:
    """Call the command that the words name and return its exit code. Raises UsageError for words that name no command.

    name: of the program, in messages.
    """
    try:
        code = commands(args=list(words), prog_name=name, standalone_mode=False)
    except typer.TyperException as error:
        return _help_or_refusal(error)
    return code if isinstance(code, int) else 0


def _help_or_refusal(error: typer.TyperException) -> int:
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
    refusal = UsageError(what, where=where or path, found=found, allowed=allowed, next_step=step)
    raise refusal if context is None else _with_lines(context, refusal)


class Command(TyperCommand):
    """A command whose help has a panel for each group of options, or lists its USUAL_OPTIONS alone."""

    USUAL_OPTIONS: Sequence[str] = ()

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the words. Raises UsageError for an option as the value of another."""
        take = {name for one in self.get_params(ctx) if not getattr(one, "is_flag", True) for name in one.opts}
        for word, after in pairwise(args[: args.index("--")] if "--" in args else args):
            if word in take and re.match("--[a-z]", after):
                raise UsageError("needs a value", where=word, found=after, next_step=f"See `{ctx.command_path} --help`")
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Call the command. A refusal names the line of an option that a session file has."""
        try:
            return super().invoke(ctx)
        except RefusedError as error:
            placed = _with_lines(ctx, error)
            if placed is error:
                raise
            raise placed from error

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the options of the help."""
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
"""The range that typer adds to the help of a number."""
FIRST_COLUMN = 24
"""Columns of an option and its value in the help."""


def _commands(
    package: str, chosen: Sequence[str], *, epilog: str | None = None, all_options: bool = False
) -> typer.Typer:
    """The commands that `COMMANDS` of a package names. USUAL_OPTIONS of a module: those of the help, by command."""
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
            group.command(name, help=summary)(lambda: None)
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
            usual_options = () if all_options else getattr(module, "USUAL_OPTIONS", {}).get(name, ())
            kind = type("Command", (Command,), {"USUAL_OPTIONS": usual_options})
            group.command(name, cls=kind, help=described(function)[0])(command_of(function))
    return group


def _show_version(requested: bool) -> None:
    if requested:
        echo(f"retarget {retarget.__version__}")
        raise typer.Exit


def _options(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and leave.", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    """From a performer's sensors to safe servo goals."""


USUAL_VALUES = {"--realtime": str(USUAL_PRIORITY), "--control-socket": USUAL, "--view": str(VIEW_PORT)}
"""Values of options that may stand alone, which typer does not know."""


def with_values(words: Sequence[str]) -> list[str]:
    """Insert the value behind each option of USUAL_VALUES that stands alone."""
    found: list[str] = []
    for word, after in pairwise((*words, "-")):
        found.append(word)
        if word in USUAL_VALUES and after.startswith("-"):
            found.append(USUAL_VALUES[word])
    return found


def refuse_renamed(words: Sequence[str]) -> None:
    """Raise UsageError for an option that has another name now."""
    command = next((word for word in words if not word.startswith("-")), "")
    for word in words:
        option = word.partition("=")[0]
        if step := renamed_to(f"{command} {option}"):
            raise UsageError("no such option", where=option, next_step=step)


ONCE = {"batch": "--format", "export": "--to"}
"""The option of a command that chooses what it makes."""


def refuse_repeated(words: Sequence[str]) -> None:
    """Raise UsageError for several formats, of which typer would take the last."""
    option = ONCE.get(next((word for word in words if not word.startswith("-")), ""), "")
    if option and sum(word.partition("=")[0] == option for word in words) > 1:
        step = "Give the command once for each: outputs of several formats go beside each other"
        raise UsageError("several formats", where=option, allowed="one", next_step=step)


# The table of options. Type and default of an option are those of a parameter of its command or of a field of a
# dataclass. Its help is a line of the docstring there:
#
#     Options:
#         robot NAME|PATH: Robot by name or path.
#         iterations (--n-ik) N: Iterations per frame at most.
#         jobs N 1..256: Processes that share the work.
#
# `Arguments:` describes arguments. Any other heading names a panel of the help. A parameter that is a dataclass is a
# group of options: its fields that are described, there or by the command. A session file reads the same table.

SHARED = """
Options:
    robot NAME|PATH: Robot by name or path.
    scene NAME|FILE: The scene: table, wall, ..., or a file.
    body FILE: The robot's MJCF or URDF, where FILE names none that is there.
    yes: Do not ask.
    dry_run: Say what would be done, and do not open a port.

Results:
    overwrite: Replace files that are there; else they are refused.
"""
"""Options of several commands, which need not describe them."""
_HEADING = re.compile(r"([A-Z][\w ]*):")
_ENTRY = re.compile(r"    (\w+)(?: \((.+?)\))?(?: (\S+))??(?: ([\d.]+?)\.\.([\d.]*))?: (.+)")


@dataclass(frozen=True)
class _Entry:
    """Help of one option. flags: as typed, where they are not its name with dashes. range: least and greatest."""

    heading: str
    flags: tuple[str, ...]
    metavar: str | None
    range: tuple[str, str]
    help: str


def described(holder: Callable[..., Any] | str) -> tuple[str, dict[str, _Entry]]:
    """The docstring of a function or dataclass without its options, and these by name."""
    text: list[str] = []
    entries: dict[str, _Entry] = {}
    heading = name = ""
    doc = holder if isinstance(holder, str) else inspect.getdoc(holder) or ""
    for line in doc.splitlines():
        if (found := _HEADING.fullmatch(line)) and found[1] != "Examples":
            heading = found[1]
        elif not heading:
            text += ["\b"] * bool(found)  # for typer: what follows is not wrapped
            text.append(line)
        elif found := _ENTRY.fullmatch(line):
            name, flags, metavar, least, greatest, words = found.groups()
            split = tuple(flags.split(", ")) if flags else ()
            entries[name] = _Entry(heading, split, metavar, (least or "", greatest or ""), words)
        elif line:
            entries[name] = replace(entries[name], help=f"{entries[name].help} {line.strip()}")
    return "\n".join(text).strip(), entries


def command_of(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function whose signature typer reads, and that calls `function` with its groups built."""

    @wraps(function)
    def command(**values: Any) -> Any:
        return _built(function, values)

    parameters = list(_parameters(function, described(SHARED)[1], {}))
    parameters.sort(key=lambda one: one.default is not one.empty)  # the required first
    command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return command


def _parameters(
    holder: Callable[..., Any], shared: Mapping[str, _Entry], by_command: Mapping[str, _Entry]
) -> Iterator[inspect.Parameter]:
    """The options of a function or group, as the command describes them, else the group, else SHARED."""
    by_command = {**described(holder)[1], **by_command}
    known = {**shared, **by_command}
    for parameter in inspect.signature(holder).parameters.values():
        if is_dataclass(parameter.annotation):
            yield from _parameters(parameter.annotation, shared, by_command)  # type: ignore[arg-type]
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
        least, greatest = (float(end) if "." in end else int(end) if end else None for end in entry.range)
        info = typer.Option(
            *flags,
            help=entry.help,
            metavar=entry.metavar,
            min=least,
            max=greatest,
            rich_help_panel=panel,
            show_default=shown,
        )
    return parameter.replace(kind=parameter.KEYWORD_ONLY, annotation=Annotated[_typed(kind), info])


def _typed(kind: Any) -> Any:
    """The type that typer reads. A choice is text to it: the command checks it and suggests the nearest."""
    parts = get_args(kind) or (kind,)
    if get_origin(kind) is tuple:
        return list[parts[0]]  # type: ignore[valid-type]
    if get_origin(kind) is Literal or any(get_origin(part) is Literal for part in parts):
        return str | None if NoneType in parts else str
    return kind


def _built(holder: Callable[..., Any], values: Mapping[str, Any]) -> Any:
    arguments = {}
    for name, parameter in inspect.signature(holder).parameters.items():
        kind = parameter.annotation
        if is_dataclass(kind):
            arguments[name] = _built(kind, values)  # type: ignore[arg-type]
        elif name in values:
            arguments[name] = tuple(values[name]) if get_origin(kind) is tuple else values[name]
    return holder(**arguments)


# A session file: options of a command in YAML.

SESSION = "retarget.session"
"""Key of the file's document in the `meta` of a context."""
REPLAY = "replay://"
"""Scheme of the addresses that name a file."""
READ = ("source", "skeleton", "robot", "performer", "priorities", "scene", "faults")
"""Options that may name a file to read. A relative path in a session file counts from the folder of that file."""


def session_options(document: "Document", command: Callable[..., Any]) -> dict[str, Callable[[], Any]]:
    """A function for each value of a session file, by parameter of the command. The keys are its options.

    The function is called only where the command line has no value. It raises ConfigError for a file that is not there.
    Raises ConfigError with all problems of the document.
    """
    from pydantic import create_model

    from retarget.schema.strict_models import Schema, validated

    kinds: dict[str, Any] = {}
    parameters: dict[str, str] = {}
    for name, parameter in inspect.signature(command).parameters.items():
        kind, info = get_args(parameter.annotation)
        if isinstance(info, OptionInfo):
            # Typer calls the first flag of an annotation its default.
            option = info.default if isinstance(info.default, str) else f"--{name.replace('_', '-')}"
            option = option.partition("/")[0]
            key = option.removeprefix("--")
            kinds[key], parameters[key] = (_kind_of(kind, option) | None, None), name
    model = create_model("Session", __base__=Schema, **kinds)
    read = validated(model, document)

    def value_of(key: str, value: Any) -> Any:
        return _from_folder(document, key, value) if key in READ else value

    given = read.model_dump(exclude_none=True)
    return {parameters[key]: partial(value_of, key, value) for key, value in given.items()}


def _from_folder(document: "Document", key: str, text: str) -> str:
    """A path of a session file, counted from its folder; names and addresses stay. Raises ConfigError for no file."""
    replayed = text.startswith(REPLAY)
    place, question, query = text.removeprefix(REPLAY).partition("?") if replayed else (text, "", "")
    is_name = key not in ("skeleton", "faults") and Path(place).name == place and not Path(place).suffix
    if is_name or (is_address(text) and not replayed) or Path(place).is_absolute():
        return text
    folder, here = document.path.parent.absolute(), Path(place).absolute()
    path, step = folder / place, "Check the path"
    if not path.exists():
        found = f"nothing at {path}"
        if here.exists():
            found, step = f"{found}, but {here}", f"Write {os.path.relpath(here, folder)}, or move it"
        elif here != path:
            found += f", nor at {here}"
        allowed = "a path from the folder of the session file"
        problem = document.problem((key,), "there is no such file", found=found, allowed=allowed, next_step=step)
        raise ConfigError.from_problems([problem])
    return f"{REPLAY if replayed else ''}{path}{question}{query}"


def _kind_of(kind: Any, option: str) -> Any:
    """The type of a value in a session file. `true` means the usual value of an option that may stand alone."""
    from pydantic import BeforeValidator

    from retarget.schema.strict_models import Integer, Number, Switch, Text, one_or_more

    if get_origin(kind) is list:
        return Annotated[list[Text], BeforeValidator(one_or_more)]
    (known,) = set(get_args(kind) or (kind,)) - {NoneType}
    value: Any = {bool: Switch, float: Number, int: Integer}.get(known, Text)
    if usual := USUAL_VALUES.get(option):
        return Annotated[value, BeforeValidator(lambda given: known(usual) if given is True else given)]
    return value


def _read_session(context: typer.Context, session: str | None) -> str | None:
    from retarget.schema.catalogue import Kind, read_as

    if session is not None:
        command, document = context.command.callback, read_as(Kind.SESSION, session)
        assert command is not None
        context.default_map = session_options(document, command)
        context.meta[SESSION] = document
    return session


def _with_lines(context: Any, error: RefusedError) -> RefusedError:
    """The error, which names the place in the session file of each option that was not typed."""
    document: Document | None = context.meta.get(SESSION)
    if document is None:
        return error
    parameters = context.command.get_params(context)
    # The type of a source is private to typer.
    in_file = [
        one for one in parameters if getattr(context.get_parameter_source(one.name), "name", "") == "DEFAULT_MAP"
    ]
    options = {option for one in in_file for option in one.opts}
    problems = []
    for problem in error.problems:
        details = {"found": problem.found, "allowed": problem.allowed, "next_step": problem.next_step}
        named = [option for option in re.findall("--[a-z-]+", problem.where) if option in options]
        if named:
            problem = document.problem((named[0].removeprefix("--"),), problem.what, **details)
        problems.append(problem)
    return type(error).from_problems(problems)


Session = Annotated[
    str | None,
    typer.Argument(
        help="Options; typed ones win: --no-loop undoes `loop: true`.",
        metavar="SESSION.yaml",
        show_default=False,
        callback=_read_session,
        is_eager=True,
    ),
]
"""The session file of a command: YAML with a key for each option, its name without the dashes in front."""


@dataclass(frozen=True, kw_only=True)
class FileOptions:
    """Options of reading a motion file.

    Playback:
        skeleton FILE.asf: The ASF of an AMC that has none beside it.
        markers FILE.yaml: The markers of each sensor, for C3D and TRC.
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
    """The options of a group (a dataclass) that are not at their defaults, as typed. but: fields to leave out."""
    counted = [field for field in fields(group) if field.name not in but and not is_dataclass(field.type)]
    changed = [field.name for field in counted if getattr(group, field.name) != field.default]
    return [f"--{name.replace('_', '-')}" for name in changed]


def refuse_given(options: Sequence[str], owner: str) -> None:
    """Raise UsageError for options that only another kind of source, the `owner`, has."""
    if options:
        raise UsageError(f"only a {owner} has this", where=", ".join(options), next_step="Leave it out")


# Messages to the operator go to stderr, so that a pipe gets results alone.


def log(text: str) -> None:
    """Print a line for the operator."""
    echo(text, err=True)


def note(text: str) -> None:
    """Print a note for the operator."""
    log(f"note: {text}")


def console(*, err: bool = False) -> "Console":
    """Make the console of tables and progress. It wraps no line in a pipe, and spells out control codes as `echo`."""
    from rich.console import Console, ConsoleOptions, RenderableType
    from rich.segment import Segment

    class PlainConsole(Console):
        """A console of which only its own control codes reach the terminal."""

        def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterator[Segment]:
            for text, style, control in super().render(renderable, options):
                yield Segment(text if control else printable(text), style, control)

    stream = sys.stderr if err else sys.stdout
    if stream.isatty():
        return PlainConsole(stderr=err)
    return PlainConsole(file=cast(IO[str], Unpadded(stream)), width=UNWRAPPED)


class Unpadded:
    """A stream that removes the blanks at the ends of lines of tables."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write whole lines."""
        return self._stream.write(re.sub(r" +(?=\n)", "", text))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


# Questions to the operator at the terminal.


def confirmed(question: str, *, enter: bool = True, where: str = "") -> bool:
    """Ask the operator: y is yes, n is no, ENTER alone is `enter`. where: the command, for messages.

    Raises UsageError when the input has ended.
    """
    answers = {"": enter, "y": True, "yes": True, "n": False, "no": False}
    while True:
        answer = answers.get(answered(f"{question} [{'Y/n' if enter else 'y/N'}] ", where=where).lower())
        if answer is not None:
            return answer


def answered(question: str, *, where: str = "", step: str = "Run it in a terminal") -> str:
    """The answer that the operator types. Raises UsageError, with this next step, when the input has ended."""
    try:
        return input(printable(question)).strip()
    except EOFError as error:
        echo()
        raise UsageError("the question has no answer: the input has ended", where=where, next_step=step) from error


@contextmanager
def progress_bar(what: str, total: int | None) -> Iterator[Callable[[int], None]]:
    """Show a bar on a terminal. Yields a function that takes the amount done of `total` (None: not known)."""
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
