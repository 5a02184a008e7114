"""A type of a configuration model in words for a person who writes YAML."""

from collections.abc import Iterator
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MultipleOf
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from retarget.schema import priorities, profile_parts
from retarget.schema.priorities import RowWeights
from retarget.schema.strict_models import Interval, Name, Quaternion, Text

KNOWN: tuple[tuple[Any, str], ...] = (
    (Name, "name"),
    (Text, "text"),
    (Quaternion, "[w, x, y, z]"),
    (Interval, "[lower, upper]"),
    (RowWeights, "number or [x, y, z]"),
    (profile_parts.Names, "name or list of names"),
    (priorities.Names, "name or list of names"),
)
"""Types with a word of their own."""
PLAIN = {float: "number", int: "whole number", str: "text", bool: "true or false", NoneType: "", Path: "path"}


def words(hint: Any) -> str:
    """A type in words; models are links to their section of the same page."""
    for known, word in KNOWN:
        if hint == known:
            return word
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _bounded(words(inner[0]), inner[1:])
    if origin is Literal:
        return " or ".join(f"`{value}`" for value in inner)
    if origin in (Union, UnionType):
        return " or ".join(filter(None, map(words, inner)))
    if origin is dict:
        return f"by {words(inner[0])}: {words(inner[1])}"
    if origin is tuple:
        return _row(inner)
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        return f"[{hint.__name__}](#{hint.__name__.lower()})"
    return PLAIN[hint]


def models_in(hint: Any) -> Iterator[type[BaseModel]]:
    """The models that a type is made of, in its order."""
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        yield hint
    for inner in get_args(hint):
        yield from models_in(inner)


def _row(inner: tuple[Any, ...]) -> str:
    if inner[-1] is Ellipsis:
        return f"list of {_several(words(inner[0]))}"
    if len(set(inner)) == 1:
        return f"{len(inner)} {_several(words(inner[0]))}"
    return "[" + ", ".join(map(words, inner)) + "]"


def _several(word: str) -> str:
    """The plural, of those words that stand first."""
    for one in ("whole number", "number", "name"):
        if word == one or word.startswith((f"{one} from", f"{one} above")):
            return word.replace(one, f"{one}s", 1)
    return word if word.startswith("[") else f"entries, each {word}"


def _bounded(word: str, metadata: tuple[Any, ...]) -> str:
    """A number with its bounds."""
    if word not in ("number", "whole number"):
        return word
    parts = [part for entry in metadata for part in (entry.metadata if isinstance(entry, FieldInfo) else (entry,))]
    low = next((part for part in parts if isinstance(part, Ge | Gt)), None)
    high = next((part for part in reversed(parts) if isinstance(part, Le | Lt)), None)
    step = next((part for part in parts if isinstance(part, MultipleOf)), None)
    words_of = []
    if isinstance(low, Gt):
        words_of.append(f"above {low.gt:g}")
    elif isinstance(low, Ge):
        words_of.append(f"from {low.ge:.10g}")
    if isinstance(high, Le):
        words_of.append(f"to {high.le:.10g}")
    elif isinstance(high, Lt):
        words_of.append(f"below {high.lt:g}")
    if step is not None:
        words_of.append(f"in steps of {step.multiple_of:g}")
    return " ".join([word, *words_of])
