"""Tables of what may be written into a configuration file, from the models that read it: key, type, unit, default,
meaning.

Unit and meaning are the docstring of the field, `[unit] Meaning.`; everything else is the model's own.
"""

import ast
import inspect
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any, get_type_hints

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from type_words import models_in, words


@dataclass(frozen=True)
class Key:
    """A key of a model. type, default: in words; unit: "" where there is none."""

    name: str
    type: str
    unit: str
    default: str
    meaning: str


def models_below(root: type[BaseModel]) -> tuple[type[BaseModel], ...]:
    """The model and all that it holds, each once, in the order in which they are met."""
    found: dict[type[BaseModel], None] = {}

    def visit(model: type[BaseModel]) -> None:
        if model in found:
            return
        found[model] = None
        for hint in _hints(model).values():
            for inner in models_in(hint):
                visit(inner)

    visit(root)
    return tuple(found)


def keys_of_model(model: type[BaseModel]) -> tuple[Key, ...]:
    """Every key that may be written, in the model's order; what it has from the models above it comes last."""
    meanings, hints = _docstrings(model), _hints(model)
    own = inspect.get_annotations(model)
    keys = []
    for name, field in sorted(model.model_fields.items(), key=lambda entry: entry[0] not in own):
        unit, meaning = _parted(meanings.get(name, ""))
        keys.append(Key(field.alias or name, words(hints[name]), unit, _default(field), meaning))
    return tuple(keys)


def section(model: type[BaseModel], title: str | None = None) -> str:
    """The table of a model under a heading of its name, in Markdown."""
    lines = [f"## {title or model.__name__}", "", inspect.cleandoc(model.__doc__ or ""), ""]
    lines += ["| key | type | unit | default | meaning |", "|---|---|---|---|---|"]
    for key in keys_of_model(model):
        cells = (f"`{key.name}`", key.type, key.unit, key.default, key.meaning)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join([*lines, ""])


def _hints(model: type[BaseModel]) -> dict[str, Any]:
    """The whole type of each field, bounds included."""
    hints = get_type_hints(model, include_extras=True)
    return {name: hints[name] for name in model.model_fields}


def _default(field: FieldInfo) -> str:
    if field.is_required() or (field.default is None and field.validate_default):
        return "**required**"
    value = field.get_default(call_default_factory=True, validated_data={})
    if value is PydanticUndefined or value is None:
        return "absent"
    return _written(value)


def _written(value: object) -> str:
    """A default as it would be written into a file."""
    if isinstance(value, BaseModel):
        return "as below"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, float):
        return f"`{value:g}`"
    if isinstance(value, dict):
        return "`{" + ", ".join(f"{name}: {entry:g}" for name, entry in value.items()) + "}`"
    if isinstance(value, tuple):
        entries = (entry if isinstance(entry, str) else f"{entry:g}" for entry in value)
        return "`[" + ", ".join(entries) + "]`" if value else "none"
    return f"`{value}`"


def _parted(docstring: str) -> tuple[str, str]:
    """Unit and meaning."""
    text = " ".join(docstring.split())
    if text.startswith("["):
        unit, _, meaning = text[1:].partition("] ")
        return unit, meaning
    return "", text


@cache
def _docstrings(model: type[BaseModel]) -> dict[str, str]:
    """The docstring of each field, those of the base classes included."""
    found: dict[str, str] = {}
    for one in reversed(model.__mro__):
        if issubclass(one, BaseModel) and one is not BaseModel:
            found |= dict(docstrings_below(one))
    return found


def docstrings_below(model: type[Any]) -> Iterator[tuple[str, str]]:
    """Every field of a class with the docstring below it, in its order."""
    body: Iterable[ast.stmt] = _class_body(model)
    field = ""
    for statement in body:
        if field and isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
            yield field, str(statement.value.value)
        target = statement.target if isinstance(statement, ast.AnnAssign) else None
        field = target.id if isinstance(target, ast.Name) else ""


def _class_body(model: type[Any]) -> list[ast.stmt]:
    module = inspect.getmodule(model)
    assert module is not None
    for node in ast.parse(inspect.getsource(module)).body:
        if isinstance(node, ast.ClassDef) and node.name == model.__name__:
            return node.body
    raise AssertionError(f"{model.__name__} is no class of its module")
