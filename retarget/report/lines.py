"""Tables of figures, bounds and sentences (`findings.yaml`), and the lines made of them."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from operator import ge, gt, lt
from pathlib import Path
from typing import Any

from hardware.errors import counted
from retarget.schema import strict_yaml


@dataclass(frozen=True)
class Finding:
    """A measured figure in words. allowed: its limit; kept: true if it was kept, None without a limit."""

    name: str
    measured: str
    allowed: str = ""
    kept: bool | None = None


_FIELD = re.compile(r"{([^{}:]+):?([^{}]*)}")
BROKEN = {"under": lt, "over": gt, "reaches": ge}
"""Comparisons of a figure with its limit that break a bound, by the key of a line."""


def figure_of(seen: object, path: object) -> Any:
    """The figure at a path of attributes, keys and indices; None where any is not known. Numbers are returned as they
    are."""
    if not isinstance(path, str):
        return path
    value: Any = seen
    for part in path.split("."):
        if isinstance(value, Mapping):
            value = value.get(part)
        elif isinstance(value, tuple) and part.isdecimal():
            value = value[int(part)]
        elif value is not None:
            value = getattr(value, part)
    return value


def _in_words(value: Any, form: str) -> str:
    """A figure in its format; "" where it is not known. `#tick|none`: a count, with a word for 0; `?`: unknown where it
    is 0."""
    if value is None or (form.startswith("?") and not value):
        return ""
    if form.startswith("#"):
        thing, _, none = form[1:].partition("|")
        return counted(value, thing) if value else none
    return format(value, form.removeprefix("?"))


def in_words(text: str | Sequence[str], seen: object) -> str:
    """A sentence with its figures, or the first of several whose figures are all known; else ""."""
    for one in [text] if isinstance(text, str) else text:
        figures = [(found, _in_words(figure_of(seen, found[1]), found[2])) for found in _FIELD.finditer(one)]
        if all(words for _, words in figures):
            said = {found[0]: words for found, words in figures}
            return _FIELD.sub(lambda found: said[found[0]], one)  # noqa: B023 - it is called at once
    return ""


@cache
def table(name: str) -> Sequence[Mapping[str, Any]]:
    """A table of `findings.yaml`."""
    tables: Any = strict_yaml.load(Path(__file__).with_name("findings.yaml")).data
    return tuple(tables[name])


def lines_of(name: str, seen: object, *, planned: str = "") -> Iterator[Finding]:
    """Yield the known lines of a table. planned: suffix of the names of lines about the plan."""
    for line in table(name):
        first = in_words(line["says"], seen)
        if first:
            also = filter(None, (in_words(text, seen) for text in line.get("also", ())))
            measured = "; ".join([first, *also])
            allowed = in_words(line.get("bound", ""), seen)
            yield Finding(line["name"] + planned * line.get("planned", False), measured, allowed, _kept(line, seen))


def _kept(line: Mapping[str, Any], seen: object) -> bool | None:
    if "broken" in line:
        broken = figure_of(seen, line["broken"])
        return None if broken is None else not broken
    pairs = [(is_beyond, *pair) for key, is_beyond in BROKEN.items() for pair in line.get(key, {}).items()]
    if not pairs:
        return None
    figures = [(is_beyond, figure_of(seen, path), figure_of(seen, limit)) for is_beyond, path, limit in pairs]
    if any(figure is None for _, figure, _ in figures):
        return None
    return not any(is_beyond(figure, limit) for is_beyond, figure, limit in figures)
