"""Messages about streams: the problem and the remedy, by symptom and kind of source, from the table `advice.yaml`."""

from collections.abc import Mapping
from fnmatch import fnmatchcase
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from retarget.errors import Problem, RefusedError
from retarget.schema import strict_yaml

MAX_SYMPTOMS = 128  # symptoms whose rows are kept: a hold reads them in every tick, and a sender may make up new ones


Refused = TypeVar("Refused", bound=RefusedError)


class Advice(NamedTuple):
    """Texts, each may be "". what: the problem; allowed: in its place; then: the remedy."""

    what: str
    allowed: str
    then: str

    @property
    def text(self) -> str:
        """Problem and remedy as one text."""
        return ". ".join(part for part in (self.what, self.then) if part)


@cache
def _rows() -> list[dict[str, str]]:
    table: Mapping[str, Any] = strict_yaml.load(Path(__file__).with_name("advice.yaml")).data
    rows: list[dict[str, str]] = table["rows"]
    return rows


@lru_cache(maxsize=MAX_SYMPTOMS)
def _row(symptom: str, kind: str) -> dict[str, str]:
    fits = (row for row in _rows() if row.get("kind", kind) == kind and fnmatchcase(symptom, row["symptom"]))
    return next(fits, {})


def advice(symptom: str, kind: str = "", **facts: Any) -> Advice:
    """The advice on a symptom of a stream of this kind, a scheme of an address, with facts filled in."""
    row = _row(symptom, kind)
    return Advice(*(row.get(part, "").format_map({**facts, "kind": kind}) for part in Advice._fields))


def problem(symptom: str, where: str, kind: str = "", *, found: str = "", **facts: Any) -> Problem:
    """The advice on a symptom as a problem. found: the given value."""
    row = advice(symptom, kind, **facts)
    return Problem(row.what, where, found=found, allowed=row.allowed, next_step=row.then)


def refusal(
    error: type[Refused], symptom: str, where: str, kind: str = "", *, found: str = "", **facts: Any
) -> Refused:
    """The advice on a symptom as an error."""
    return error.from_problems([problem(symptom, where, kind, found=found, **facts)])
