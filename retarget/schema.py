"""Models of configuration files: strict pydantic models, read through the strict YAML reader.

`Schema` is the base of every model; `read_model` reads a file as one. Cross checks that look at several keys are plain
functions from a model to problems (see `profile_checks`): they run on whatever part of the file is sound, so that a
user sees all errors of a file at once.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args, get_origin

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StrictBool, StrictInt, TypeAdapter, ValidationError
from pydantic_core import PydanticCustomError

from retarget.errors import ConfigError, Problem
from retarget.schema_errors import in_our_words, keys_at, members, model_of
from retarget.strict_yaml import Document, read_text, scan

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


def _ascending(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] >= pair[1]:
        raise PydanticCustomError(
            "inverted", "inverted limits", {"allowed": "[lower, upper], the lower one first and below the upper one"}
        )
    return pair


def _unit(quat: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    if abs(sum(part * part for part in quat) - 1.0) > 1e-3:
        raise PydanticCustomError(
            "quaternion",
            "not a unit quaternion",
            {"allowed": "[w, x, y, z] whose squares sum to 1; no turn: [1, 0, 0, 0]"},
        )
    return quat


Interval = Annotated[tuple[Number, Number], AfterValidator(_ascending)]
"""Lower and upper limit; the lower one first and below the upper one."""
Quaternion = Annotated[tuple[Number, Number, Number, Number], AfterValidator(_unit)]
"""Rotation as w x y z."""


def read_model(model: type[M], path: Path, *, check: Check[M] | None = None) -> tuple[M, Document]:
    """Read a YAML file as `model`. Raises ConfigError with all problems of the file, those of `check` included."""
    document = scan(read_text(path), path)
    problems = list(document.problems)
    try:
        read = model.model_validate(document.data)
    except ValidationError as error:
        read = _sound_part(model, document.data)
        told = {problem.where for problem in problems}
        found = in_our_words(model, error, document)
        problems += [problem for problem in found if problem.where not in told]
    if check is not None:
        problems += check(read, document)
    if problems:
        raise ConfigError.from_problems(problems, title=f"{path}: {len(problems)} problems")
    return read, document


def _sound_part(model: type[M], data: Mapping[str, Any]) -> M:
    """The model with what is sound in `data`; an unsound section is empty. Only cross checks ever see it."""
    sound: dict[str, Any] = {}
    for name, field in model.model_fields.items():
        section = data.get(field.alias or name)
        if field.annotation is None or section is None:
            sound[name] = None if field.is_required() else field.get_default(call_default_factory=True)
        else:
            sound[name] = _sound(Annotated[field.annotation, field], section)
        if sound[name] is None and get_origin(field.annotation) in (dict, tuple):
            sound[name] = get_origin(field.annotation)()  # type: ignore[misc]
    return model.model_construct(**sound)


def _sound(kind: Any, data: Any) -> Any:
    """`data` as `kind`; of a mapping its sound entries; None when nothing is sound."""
    try:
        return TypeAdapter(kind).validate_python(data)
    except ValidationError:
        pass
    leaves = members(kind)
    if get_origin(leaves[0]) is dict and isinstance(data, dict):
        value_kind = get_args(leaves[0])[1]
        entries = {name: _sound(value_kind, value) for name, value in data.items()}
        return {name: value for name, value in entries.items() if value is not None}
    model = model_of(kind)
    if model is not None and isinstance(data, dict):
        keys = set(keys_at(model, ()))
        if not keys >= data.keys():
            return _sound(kind, {key: value for key, value in data.items() if key in keys})
    return None
