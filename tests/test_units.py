"""Length units by name and by the size of the body."""

import pytest

from retarget.errors import InputError, UsageError
from retarget.sources.units import UNITS, choose_unit, named_unit
from support.messages import refuses, shows


@pytest.mark.parametrize("name", UNITS)
def test_every_human_height_finds_its_unit(name: str) -> None:
    for height in (1.4, 1.55, 1.7, 1.9, 2.1):
        unit = choose_unit(height / UNITS[name], where="here")
        assert unit.name == name and f"{height:.2f} m" in unit.note and "unusual" not in unit.note
    shows(choose_unit(1.2 / UNITS[name], where="here").note)


@pytest.mark.parametrize("height", [0.0, -1.0, float("nan"), float("inf"), 0.3, 9.0, 400.0, 1e6, None])
def test_no_unit_makes_it_human(height: float | None) -> None:
    with refuses(InputError, "--unit"):
        choose_unit(height, where="here")


def test_named_units_in_any_case() -> None:
    assert named_unit("CM").metres == 0.01 and named_unit("cm").note == ""
    with refuses(UsageError, found="'metre'"):
        named_unit("metre")
