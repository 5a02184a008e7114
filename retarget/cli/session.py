"""A session file: options of `retarget run` in YAML. The key of an option is its name without the dashes in front."""

import inspect
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, get_args, get_origin

import typer
from pydantic import BeforeValidator, create_model
from typer.models import OptionInfo

from retarget.cli.application import USUAL_VALUES
from retarget.errors import ConfigError
from retarget.live.address import is_address
from retarget.schema.catalogue import Kind, read_as
from retarget.schema.strict_models import Integer, Number, Schema, Switch, Text, one_or_more, validated
from retarget.schema.strict_yaml import Document

REPLAY = "replay://"
"""Addresses of the only kind of stream that is a file."""
KINDS: dict[Any, Any] = {bool: Switch, float: Number, int: Integer}
"""Types of options and those of their values in a file; the value of any other option is text."""


READ = ("source", "skeleton", "robot", "performer", "priorities", "scene", "faults")
"""Options that may name a file that is read; a relative path in a session file counts from that file's folder."""


def session_options(session: str | Path, command: Callable[..., Any]) -> dict[str, Callable[[], Any]]:
    """What gives the values of a session file by parameter of the command, of which each option is a key.

    session: a name or path. A value is asked for only where the command line has none: it raises ConfigError for a file
    that is not there. Raises UsageError for an unknown session, ConfigError with all problems of the file.
    """
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
    document = read_as(Kind.SESSION, session)
    read = validated(model, document)

    def value_of(key: str, value: Any) -> Any:
        return _from_folder(document, key, value) if key in READ else value

    given = read.model_dump(exclude_none=True)
    return {parameters[key]: partial(value_of, key, value) for key, value in given.items()}


def _from_folder(document: Document, key: str, text: str) -> str:
    """A path of a session file, counted from that file's folder; names and addresses stay. Raises ConfigError for a
    file that is not there."""
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
        help="Options; typed ones win: --no-loop undoes `loop: true`.",
        metavar="SESSION.yaml",
        show_default=False,
        callback=_read_session,
        is_eager=True,
    ),
]
"""The session file of a command."""
