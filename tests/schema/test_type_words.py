"""Types in words."""

from typing import Annotated, Any, Literal

import pytest
from pydantic import Field

from retarget.schema.profile_parts import Frame, Names
from retarget.schema.strict_models import (
    Integer,
    Interval,
    Name,
    NotNegative,
    Positive,
    Quaternion,
    Share,
    Switch,
    Text,
    Vector3,
)
from type_words import models_in, words


@pytest.mark.parametrize(
    ("hint", "text"),
    [
        (Name, "name"),
        (Text, "text"),
        (Switch, "true or false"),
        (Positive, "number above 0"),
        (NotNegative, "number from 0"),
        (Share, "number above 0 to 1"),
        (Annotated[Positive, Field(le=60)], "number above 0 to 60"),
        (Annotated[Integer, Field(ge=0, le=508, multiple_of=2)], "whole number from 0 to 508 in steps of 2"),
        (Vector3, "3 numbers"),
        (Quaternion, "[w, x, y, z]"),
        (Interval, "[lower, upper]"),
        (Interval | None, "[lower, upper]"),
        (Names, "name or list of names"),
        (tuple[Name, ...], "list of names"),
        (tuple[Name, Positive], "[name, number above 0]"),
        (Literal["a", 1], "`a` or `1`"),
        (dict[Name, Frame], "by name: [Frame](#frame)"),
        (Annotated[tuple[Frame, ...], Field(max_length=4)], "list of [Frame](#frame)"),
    ],
)
def test_a_type_in_words(hint: Any, text: str) -> None:
    assert words(hint) == text


def test_models_are_found_at_any_depth() -> None:
    assert list(models_in(dict[Name, Annotated[tuple[Frame, ...], Field(max_length=3)] | None])) == [Frame]
    assert list(models_in(Quaternion)) == []
