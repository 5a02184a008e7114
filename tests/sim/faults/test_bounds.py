"""The bounds of the judge are read strictly: each with a value, a unit and a reason, none missing, none unknown."""

from pathlib import Path

import pytest

from messages import refuses
from retarget.errors import ConfigError
from retarget.schema.strict_models import read_model
from sim.faults import bounds
from sim.faults.bounds import BOUNDS, Bounds
from sim.faults.rows import Reaction

TABLE = Path(bounds.__file__).with_name("bounds.yaml")
FIRST = "brake_s: {value: 0.35, unit: s,"


def test_every_reaction_has_an_entry() -> None:
    assert set(BOUNDS.reactions) == {reaction.name for reaction in Reaction}


@pytest.mark.parametrize(
    ("changed", "fact"),
    [
        ("other_s: {value: 0.35, unit: s,", "other_s"),
        ("brake_s: {value: soon, unit: s,", "brake_s"),
        ("brake_s: {value: 0.35, unit: ms,", "brake_s"),
        ("brake_s: {value: 0.35,", "brake_s"),
    ],
)
def test_an_entry_that_is_not_whole_is_refused(changed: str, fact: str, tmp_path: Path) -> None:
    path = tmp_path / "bounds.yaml"
    text = TABLE.read_text(encoding="utf-8")
    assert text.count(FIRST) == 1
    path.write_text(text.replace(FIRST, changed), encoding="utf-8")
    with refuses(ConfigError, fact):
        read_model(Bounds, path)
