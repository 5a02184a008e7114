"""Models of configuration files: pydantic models, read through the strict YAML reader.

Cross checks of several keys are functions from a model to problems (see `profile_checks`). They run on the valid part
of a file, so that a user sees all errors at once.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from math import fsum
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StrictBool, StrictInt, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from retarget.errors import ConfigError, Problem, renamed_to, suggest
from retarget.schema.strict_yaml import MAX_PROBLEMS, Document, KeyPath, read_text, scan

_PLAIN_WORDS = {
    "tuple": "a list",
    "dictionary": "a mapping of keys",
    "string": "text",
    "integer": "a whole number",
    "number": "a number",
    "boolean": "true or false",
}
"""Types of pydantic (after "a valid"), for a reader of YAML."""

_BOUNDS = {
    "too_short": ("too few entries", "at least {min_length}"),
    "too_long": ("too many entries", "at most {max_length}"),
    "string_too_short": ("too short a text", "at least {min_length} character"),
    "string_too_long": ("too long a text", "at most {max_length} characters"),
    "string_pattern_mismatch": ("wrong value", "text that matches {pattern}"),
}
"""Errors of length and form: problem, and allowed values."""


def unknown_name(document: Document, key_path: KeyPath, kind: str, name: str, known: Iterable[str]) -> Problem:
    """The problem that `name`, at `key_path`, is none of the `known` names of that `kind`."""
    names = tuple(known)
    step = suggest(name, names) or f"Name a known {kind}"
    return document.problem(key_path, f"unknown {kind}", found=repr(name), allowed=listed(names), next_step=step)


def listed(names: Iterable[str], *, limit: int = 30) -> str:
    """Names for a message, in their own order, cut to `limit`."""
    every = tuple(names)
    more = f" and {len(every) - limit} more" if len(every) > limit else ""
    return ", ".join(every[:limit]) + more if every else "none"


def keys_of(document: Document, section: str) -> tuple[str, ...]:
    """The names that a section of the file gives entries to, valid or not."""
    entries = document.data.get(section)
    return tuple(entries) if isinstance(entries, dict) else ()


def _renamed_inside(data: Any, path: KeyPath, document: Document, *, renamed: bool = False) -> Iterator[Problem]:
    """The old keys inside sections that have an old name themselves: no model has looked at those."""
    for key, value in data.items() if isinstance(data, dict) else ():
        if renamed and (step := renamed_to(key)):
            yield document.problem((*path, key), "unknown key", found=repr(key), next_step=step)
        yield from _renamed_inside(value, (*path, key), document, renamed=renamed or bool(renamed_to(key)))


def _problem(model: type[BaseModel], detail: ErrorDetails, document: Document) -> Problem:
    key_path = _key_path(detail["loc"], document.data)
    kind, message = detail["type"], detail["msg"]
    if kind == "extra_forbidden":
        known = keys_at(model, detail["loc"][:-1])
        name = str(key_path[-1])
        step = suggest(name, known) or "Remove the key"
        return document.problem(key_path, "unknown key", found=repr(name), allowed=listed(known), next_step=step)
    if kind == "union_tag_not_found":
        key_path = (*key_path, "type")
    if kind in ("missing", "union_tag_not_found"):
        return document.problem(key_path, "missing key", next_step=f"Add {str(key_path[-1])!r}")
    if kind in _BOUNDS:
        what, allowed = _BOUNDS[kind]
        shown, allowed = _shown(_value_at(document.data, key_path)), allowed.format(**detail["ctx"])
        return document.problem(key_path, what, found=shown, allowed=allowed)
    expected = expected_by(message)
    if kind == "union_tag_invalid":
        expected = str(detail.get("ctx", {}).get("expected_tags", ""))
        key_path = (*key_path, "type")
    allowed = str(detail.get("ctx", {}).get("allowed", expected))  # our validators bring theirs
    found = _value_at(document.data, key_path)
    names = re.findall(r"'([^']+)'", expected)
    return document.problem(
        key_path,
        "wrong value" if expected else message,
        found=_shown(found),
        allowed=allowed,
        next_step=suggest(found, names) if isinstance(found, str) else "",
    )


def expected_by(message: str) -> str:
    """The values allowed by a message of pydantic, in plain words; "" for our validators, whose messages are
    complete."""
    if not message.startswith("Input should be "):
        return ""
    expected = message.removeprefix("Input should be ").removeprefix("a valid ")
    return _PLAIN_WORDS.get(re.split(" or instance of |, unable to parse", expected)[0], expected)


def _key_path(loc: tuple[int | str, ...], data: object) -> KeyPath:
    """pydantic's place without what is not in the file (names of union members)."""
    path: list[int | str] = []
    for index, part in enumerate(loc):
        last = index == len(loc) - 1
        # The name of a member may be that of a key too, as of an axis task: it comes first.
        if not last and index and isinstance(loc[index - 1], int) and _value_at(data, ("type",)) == part:
            continue
        if isinstance(data, dict) and part in data:
            data = data[str(part)]
        elif isinstance(data, list) and isinstance(part, int) and part < len(data):
            data = data[part]
        elif not last or not isinstance(data, dict) or part == "[key]":
            continue
        path.append(part)
    return tuple(path)


def _value_at(data: object, key_path: KeyPath) -> object:
    for part in key_path:
        if isinstance(data, dict):
            data = data.get(str(part))
        elif isinstance(data, list) and isinstance(part, int):
            data = data[part]
    return data


def _shown(value: object) -> str:
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def keys_at(kind: Any, loc: tuple[int | str, ...]) -> list[str]:
    """The keys that the model at pydantic's place `loc` accepts."""
    for part in loc:
        kind = _inner(kind, part)
    model = model_of(kind)
    return [field.alias or name for name, field in model.model_fields.items()] if model else []


def _inner(kind: Any, part: int | str) -> Any:
    """The type one step further down: a field, an entry of a container, or the named member of a union."""
    leaves = members(kind)
    for member in leaves:
        if isinstance(member, type) and issubclass(member, BaseModel):
            for name, field in member.model_fields.items():
                if part in (name, field.alias):
                    return field.annotation
            tag = member.model_fields.get("type")
            if tag is not None and part in get_args(tag.annotation):
                return member
        elif get_origin(member) in (dict, list, tuple):
            arguments = [argument for argument in get_args(member) if argument is not Ellipsis]
            return arguments[-1]
    return None


def model_of(kind: Any) -> type[BaseModel] | None:
    """The only model among the members of a type; None where there is none, or a choice."""
    models = [member for member in members(kind) if isinstance(member, type) and issubclass(member, BaseModel)]
    return models[0] if len(models) == 1 else None


def members(kind: Any) -> list[Any]:
    """The members of a union, the type itself otherwise; annotations are stripped."""
    if get_origin(kind) is Annotated:
        return members(get_args(kind)[0])
    if get_origin(kind) in (Union, UnionType):
        return [leaf for member in get_args(kind) for leaf in members(member)]
    return [kind]


Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)]
Share = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, le=1)]
Integer = StrictInt
Switch = StrictBool
Name = Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[^\s/\\]+$")]
Text = Annotated[str, Field(min_length=1, max_length=2000)]
Vector3 = tuple[Number, Number, Number]


class Schema(BaseModel):
    """Base of all configuration models: frozen, no unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True)


M = TypeVar("M", bound=Schema)
Check = Callable[[M, Document], list[Problem]]


def ascending(pair: tuple[float, float]) -> tuple[float, float]:
    """Refuse limits of which the lower one is not below the upper one."""
    if pair[0] >= pair[1]:
        raise PydanticCustomError(
            "inverted", "inverted limits", {"allowed": "[lower, upper], the lower one first and below the upper one"}
        )
    return pair


def _unit(quat: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    if abs(fsum(part * part for part in quat) - 1.0) > 1e-3:
        raise PydanticCustomError(
            "quaternion",
            "not a unit quaternion",
            {"allowed": "[w, x, y, z] whose squares sum to 1; no turn: [1, 0, 0, 0]"},
        )
    return quat


def one_or_more(value: Any) -> Any:
    """Read `name` as `[name]`."""
    return (value,) if isinstance(value, str) else value


Interval = Annotated[tuple[Number, Number], AfterValidator(ascending)]
"""Lower and upper limit; the lower one first and below the upper one."""
Quaternion = Annotated[tuple[Number, Number, Number, Number], AfterValidator(_unit)]
"""Rotation as w x y z."""


def read_model(model: type[M], path: Path, *, check: Check[M] | None = None) -> M:
    """Read a YAML file as `model`. Raises ConfigError with all problems of the file, those of `check` included."""
    return validated(model, scan(read_text(path), path), check=check)


def validated(model: type[M], document: Document, *, check: Check[M] | None = None) -> M:
    """A document that is read, as `model`. Raises ConfigError as `read_model`."""
    problems = list(document.problems)
    try:
        read = model.model_validate(document.data)
    except ValidationError as error:
        read = _valid_part(model, document.data)
        reported = {problem.where for problem in problems}
        details = error.errors(include_url=False, include_input=False)[:MAX_PROBLEMS]
        inside = {detail["loc"][:end] for detail in details for end in range(len(detail["loc"]))}
        # A list whose entries are all wrong is also reported as too short, which adds nothing.
        useful = [detail for detail in details if not (detail["type"] == "too_short" and detail["loc"] in inside)]
        found = [_problem(model, detail, document) for detail in useful]
        found += _renamed_inside(document.data, (), document)
        problems += [problem for problem in found if problem.where not in reported]
    if check is not None:
        problems += check(read, document)
    if problems:
        raise ConfigError.from_problems(problems, title=f"{document.path}: {len(problems)} problems")
    return read


def _valid_part(model: type[M], data: Mapping[str, Any]) -> M:
    """The model of the valid part of `data` for cross checks; invalid sections are empty."""
    valid: dict[str, Any] = {}
    for name, field in model.model_fields.items():
        section = data.get(field.alias or name)
        if field.annotation is None or section is None:
            valid[name] = None if field.is_required() else field.get_default(call_default_factory=True)
        else:
            valid[name] = _validated(Annotated[field.annotation, field], section)
        if valid[name] is None and get_origin(field.annotation) in (dict, tuple):
            valid[name] = get_origin(field.annotation)()  # type: ignore[misc]
    return model.model_construct(**valid)


def _validated(kind: Any, data: Any) -> Any:
    """`data` as `kind`; of a mapping its valid entries; None when nothing is valid."""
    try:
        return TypeAdapter(kind).validate_python(data)
    except ValidationError:
        pass
    leaves = members(kind)
    if get_origin(leaves[0]) is dict and isinstance(data, dict):
        value_kind = get_args(leaves[0])[1]
        entries = {name: _validated(value_kind, value) for name, value in data.items()}
        return {name: value for name, value in entries.items() if value is not None}
    model = model_of(kind)
    if model is not None and isinstance(data, dict):
        keys = set(keys_at(model, ()))
        if not keys >= data.keys():
            return _validated(kind, {key: value for key, value in data.items() if key in keys})
    return None
