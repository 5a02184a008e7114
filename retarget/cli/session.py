"""A session file: options of `retarget run` in YAML. The key of an option is its name without the dashes in front."""

import inspect
from collections.abc import Callable
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, get_args, get_origin

import typer
from pydantic import BeforeValidator, create_model
from typer.models import OptionInfo

from retarget.cli.application import USUAL_VALUES
from retarget.schema.catalogue import Kind, find
from retarget.schema.strict_models import Integer, Number, Schema, Switch, Text, one_or_more, read_model

KINDS: dict[Any, Any] = {bool: Switch, float: Number, int: Integer}
"""Types of options and those of their values in a file; the value of any other option is text."""


def session_options(session: str | Path, command: Callable[..., Any]) -> dict[str, Any]:
    """The values of a session file by parameter of the command, of which each option is a key.

    session: a name or path. Raises UsageError for an unknown one, ConfigError with all problems of the file.
    """
    kinds: dict[str, Any] = {}
    parameters: dict[str, str] = {}
    for name, parameter in inspect.signature(command).parameters.items():
        kind, info = get_args(parameter.annotation)
        if isinstance(info, OptionInfo):
            # Typer calls the first flag of an annotation its default.
            option = info.default if isinstance(info.default, str) else f"--{name.replace('_', '-')}"
            key = option.removeprefix("--")
            kinds[key], parameters[key] = (_kind_of(kind, option) | None, None), name
    model = create_model("Session", __base__=Schema, **kinds)
    read, _ = read_model(model, find(Kind.SESSION, session))
    return {parameters[key]: value for key, value in read.model_dump(exclude_none=True).items()}


def _kind_of(kind: Any, option: str) -> Any:
    """The type of an option's value in a file; `true` is the usual value of an option that may stand alone."""
    if get_origin(kind) is list:
        return Annotated[list[Text], BeforeValidator(one_or_more)]
    (known,) = set(get_args(kind) or (kind,)) - {NoneType}
    value = KINDS.get(known, Text)
    if usual := USUAL_VALUES.get(option):
        return Annotated[value, BeforeValidator(lambda given: known(usual) if given is True else given)]
    return value


def _read_session(context: typer.Context, session: str | None) -> str | None:
    """Take the options of a session file wherever the command line has none."""
    if session is not None:
        command = context.command.callback
        assert command is not None
        context.default_map = session_options(session, command)
    return session


Session = Annotated[
    str | None,
    typer.Argument(
        help="File of options; those typed here win.",
        metavar="SESSION.yaml",
        show_default=False,
        callback=_read_session,
        is_eager=True,
    ),
]
"""The session file of a command."""
