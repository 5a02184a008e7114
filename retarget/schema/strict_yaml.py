"""Strict YAML: text to plain data, with the line of every key.

Accepted: one UTF-8 document of at most 1 MiB of mappings with text keys, lists and scalars, at most 16 levels deep.
Refused: duplicate keys, anchors and aliases, tags, directives, several documents, numbers that are not finite. Plain
scalars follow the YAML 1.2 core schema (https://yaml.org/spec/1.2.2/#103-core-schema), so `no` and `1:30` are text.
`012` is refused: twelve to some, ten to others. All problems of a file are collected.
"""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias, TypedDict, Unpack

import yaml
from yaml import events as ev

from retarget.errors import ConfigError, Problem

MAX_BYTES = 1 << 20
MAX_DEPTH = 16
MAX_VALUES = 50_000
"""Most keys and values in one file."""
MAX_PROBLEMS = 200
"""The reading ends when so many problems have been found."""
MAX_INTEGER = 2**53
"""Largest integer that every reader of the file (float64 included) holds exactly."""

Scalar: TypeAlias = str | int | float | bool | None
Node: TypeAlias = "Scalar | list[Node] | dict[str, Node]"
KeyPath: TypeAlias = tuple[str | int, ...]

_WORDS = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_DECIMAL = re.compile(r"[-+]?[0-9]+")
_LEADING_ZERO = re.compile(r"[-+]?0[0-9]+")
_OCTAL = re.compile(r"0o[0-7]+")
_HEX = re.compile(r"0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")

_Loader: type = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # same events; libyaml is ten times faster


class _Details(TypedDict, total=False):
    """Optional parts of a `Problem`."""

    found: str
    allowed: str
    next_step: str


@dataclass(frozen=True)
class Document:
    """A YAML file as plain data. lines: from 1, by key path (keys and list indices from the top). problems: found by
    the strict reader; the data then have holes (None)."""

    path: Path
    data: dict[str, Node]
    lines: dict[KeyPath, int] = field(repr=False)
    problems: tuple[Problem, ...] = ()

    def problem(self, key_path: KeyPath, what: str, **details: Unpack[_Details]) -> Problem:
        """A problem at `file:line: dotted.key`; the line is that of the nearest parent that stands in the file."""
        known = key_path
        while known and known not in self.lines:
            known = known[:-1]
        return _problem(self.path, self.lines.get(known, 1), key_path, what, **details)


def load(path: Path) -> Document:
    """Strict YAML of a file whose top level is a mapping. Raises ConfigError with all problems found."""
    document = scan(read_text(path), path)
    if document.problems:
        raise ConfigError.from_problems(document.problems, title=f"{path}: {len(document.problems)} problems")
    return document


def scan(text: str, path: Path) -> Document:
    """Strict YAML from text; `path` is for messages. Problems are in `Document.problems`. Raises ConfigError without a
    mapping."""
    builder = _Builder(path, text)
    data: Node = None
    try:
        data = builder.document(yaml.parse(text, Loader=_Loader))
    except yaml.YAMLError as error:
        builder.syntax_problem(error)
    except _HopelessError:
        pass  # the reason is already among the problems
    else:
        if not isinstance(data, dict):
            found = "an empty file" if data is None else _kind(data)
            allowed = "lines of the form `key: value`"
            builder.problem(1, (), "the file is not a mapping of keys", found=found, allowed=allowed)
    if not isinstance(data, dict):
        raise ConfigError.from_problems(builder.problems, title=f"{path}: {len(builder.problems)} problems")
    return Document(path, data, builder.lines, tuple(builder.problems))


class _Dumper(yaml.SafeDumper):
    """Writes text so that the scalars of this reader cannot be meant, and everything out where it stands."""

    def ignore_aliases(self, data: object) -> bool:
        return True

    def represent_str(self, data: str) -> yaml.ScalarNode:
        style = None if isinstance(_core(data), str) else '"'
        return self.represent_scalar("tag:yaml.org,2002:str", data, style=style)


_Dumper.add_representer(str, _Dumper.represent_str)


def dump(data: Mapping[str, Any], *, comment: str) -> str:
    """Data as a file that `scan` reads back, under a comment of one line; innermost lists and mappings on one line."""
    text = yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, default_flow_style=None, width=math.inf)
    return f"# {comment}\n{text}"


def dotted(key_path: KeyPath) -> str:
    """`servos.l_el.limits[0]` for ("servos", "l_el", "limits", 0)."""
    text = ""
    for key in key_path:
        text += f"[{key}]" if isinstance(key, int) else f".{key}" if text else key
    return text


def read_text(path: Path) -> str:
    """The text of a regular file of at most 1 MiB in UTF-8 (a byte order mark is skipped). Raises ConfigError."""
    try:
        if not path.is_file():
            what = "this is a folder, not a file" if path.is_dir() else "there is no such file"
            raise ConfigError(what, where=str(path), next_step="Check the path")
        with path.open("rb") as stream:
            raw = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(f"the file cannot be read: {reason}", where=str(path), next_step="Check the path") from None
    if len(raw) > MAX_BYTES:
        raise ConfigError("the file is too large", where=str(path), found="more than 1 MiB", allowed="at most 1 MiB")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        found = f"byte 0x{raw[error.start]:02x}"
        raise ConfigError("the file is not UTF-8 text", where=f"{path}:{line}", found=found, allowed="UTF-8") from None


class _Builder:
    """Turns parser events into data; collects problems and lines."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.last_line = text.rstrip().count("\n") + 1
        self.problems: list[Problem] = []
        self.lines: dict[KeyPath, int] = {}
        self.values = 0

    def problem(self, line: int, key_path: KeyPath, what: str, **details: Unpack[_Details]) -> None:
        self.problems.append(_problem(self.path, line, key_path, what, **details))
        if len(self.problems) >= MAX_PROBLEMS:
            raise _HopelessError

    def syntax_problem(self, error: yaml.YAMLError) -> None:
        """Add the error of the parser, which cannot go on."""
        began = getattr(error, "context_mark", None)
        mark = getattr(error, "problem_mark", None) or began
        reason = getattr(error, "problem", None) or getattr(error, "reason", None) or str(error).splitlines()[0]
        line = min(mark.line + 1, self.last_line) if mark else 1
        if began and (context := getattr(error, "context", None)):
            reason = f"{reason}, {context} that starts in line {began.line + 1}"
        where = f"{self.path}:{line}" if mark else str(self.path)
        step = "Check indentation, quotes and brackets near this line"
        self.problems.append(Problem(f"not valid YAML: {reason}", where, next_step=step, line=line))

    def document(self, events: Iterator[ev.Event]) -> Node:
        """The first document of the stream; a second one is a problem."""
        data: Node = None
        documents = 0
        for event in events:
            line = _line(event)
            if isinstance(event, ev.DocumentStartEvent):
                documents += 1
                if event.version or event.tags:
                    self.problem(line, (), "directives are not used here", found="a line that starts with %")
                if documents > 1:
                    self.problem(line, (), "a second document in the file", found="---", allowed="one document")
                    return data
                data = self.node(next(events), events, ())
        return data

    def node(self, event: ev.Event, events: Iterator[ev.Event], key_path: KeyPath) -> Node:
        """The value that starts with `event`; consumes its events."""
        line = _line(event)
        self.lines.setdefault(key_path, line)
        self.values += 1
        if self.values > MAX_VALUES:
            self.problem(line, key_path, "the file holds too many values", allowed=f"at most {MAX_VALUES}")
            raise _HopelessError
        if anchor := getattr(event, "anchor", None):
            kind, sign = ("alias", "*") if isinstance(event, ev.AliasEvent) else ("anchor", "&")
            found = f"{sign}{anchor}"
            self.problem(line, key_path, f"an {kind} is not allowed", found=found, allowed="the value written out")
        if tag := getattr(event, "tag", None):
            self.problem(line, key_path, "a tag is not allowed", found=str(tag), allowed="plain YAML values")
        if isinstance(event, ev.ScalarEvent):
            return self.scalar(event, key_path)
        if isinstance(event, ev.AliasEvent):
            return None
        if len(key_path) >= MAX_DEPTH:
            self.problem(line, key_path[:4], "the file is nested too deep", allowed=f"{MAX_DEPTH} levels")
            raise _HopelessError
        if isinstance(event, ev.SequenceStartEvent):
            return self.sequence(events, key_path)
        return self.mapping(events, key_path)

    def sequence(self, events: Iterator[ev.Event], key_path: KeyPath) -> list[Node]:
        items: list[Node] = []
        while not isinstance(event := next(events), ev.SequenceEndEvent):
            items.append(self.node(event, events, (*key_path, len(items))))
        return items

    def mapping(self, events: Iterator[ev.Event], key_path: KeyPath) -> dict[str, Node]:
        items: dict[str, Node] = {}
        while not isinstance(event := next(events), ev.MappingEndEvent):
            line = _line(event)
            key = self.key(event, events, key_path)
            here = (*key_path, key)
            if key in items:
                first = self.lines[here]
                self.problem(
                    line, here, "duplicate key", found=f"the same key in line {first}", allowed="each key once"
                )
            else:
                self.lines[here] = line
            value = self.node(next(events), events, here)
            items.setdefault(key, value)
        return items

    def key(self, event: ev.Event, events: Iterator[ev.Event], key_path: KeyPath) -> str:
        """A mapping key; anything but text is a problem, and stands in as text that cannot clash."""
        value = self.node(event, events, (*key_path, "?"))
        self.lines.pop((*key_path, "?"), None)
        if isinstance(value, str) and value:
            return value
        line = _line(event)
        found = _kind(value) if isinstance(value, list | dict) else f"{getattr(event, 'value', '')!r}"
        self.problem(line, key_path, "a key that is not text", found=found, allowed="a name, in quotes if need be")
        return f"?{line}:{len(self.problems)}"

    def scalar(self, event: ev.ScalarEvent, key_path: KeyPath) -> Scalar:
        """A scalar by the core schema; quoted and block scalars are text."""
        text: str = event.value
        if not event.implicit[0] or event.style in ("'", '"', "|", ">"):
            return text
        value, line, found = _core(text), _line(event), text[:40]
        if _NOT_FINITE.fullmatch(text) or (isinstance(value, float) and not math.isfinite(value)):
            what, step = "a number that is not finite", "Write the number itself"
            self.problem(line, key_path, what, found=found, allowed="a finite number", next_step=step)
        elif isinstance(value, int) and abs(value) > MAX_INTEGER:
            allowed = f"between -{MAX_INTEGER} and {MAX_INTEGER}"
            self.problem(line, key_path, "a number out of range", found=found, allowed=allowed)
        elif _LEADING_ZERO.fullmatch(text):
            what, allowed = "a number that begins with 0: octal to some readers", "12, or 0o12 for octal"
            self.problem(line, key_path, what, found=found, allowed=allowed)
        return value


class _HopelessError(Exception):
    """Ends the reading early; the problems are already noted."""


def _problem(path: Path, line: int, key_path: KeyPath, what: str, **details: Unpack[_Details]) -> Problem:
    where = f"{path}:{line}" + (f": {dotted(key_path)}" if key_path else "")
    return Problem(what, where, line=line, **details)


def _line(event: ev.Event) -> int:
    """Line of the file, from 1, where an event starts."""
    return event.start_mark.line + 1 if event.start_mark else 1


def _core(text: str) -> Scalar:
    """A plain scalar by the YAML 1.2 core schema."""
    if text in _WORDS:
        return _WORDS[text]
    if _DECIMAL.fullmatch(text):
        # int() refuses thousands of digits; such a number is out of range as a float too, or merely absurd.
        return int(text) if len(text) <= 400 else math.inf
    if _OCTAL.fullmatch(text) or _HEX.fullmatch(text):
        return int(text, 0) if len(text) <= 400 else math.inf
    if _FLOAT.fullmatch(text):
        return float(text)
    return text


def _kind(value: Node) -> str:
    if isinstance(value, list):
        return "a list"
    if isinstance(value, dict):
        return "a mapping"
    return "nothing" if value is None else repr(value)[:60]
