"""Tables of keys: every key of every configuration file is there, with its unit, and as it is read."""

import pytest
from pydantic import BaseModel

from command_pages import command_page, commands
from model_tables import keys_of_model, models_below, section
from retarget.schema.performer import Performer
from retarget.schema.priorities import PositionTask, Priorities
from retarget.schema.profile import RobotProfile
from retarget.schema.profile_parts import Bus, ProfileFrame, Servo
from retarget.schema.scene import Obstacle, PathPoint, Scene

ROOTS: tuple[type[BaseModel], ...] = (RobotProfile, Priorities, Performer, Scene)
MODELS = list(dict.fromkeys(model for root in ROOTS for model in models_below(root)))


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_every_key_has_its_meaning_where_it_stands(model: type[BaseModel]) -> None:
    keys = keys_of_model(model)
    assert {key.name for key in keys} == {field.alias or name for name, field in model.model_fields.items()}
    for key in keys:
        assert key.meaning.endswith(".") and key.type and key.default, f"{model.__name__}.{key.name}"
        assert not key.meaning.startswith("["), "a unit that is not closed"


def test_a_key_is_listed_as_it_is_read() -> None:
    keys = {key.name: key for key in keys_of_model(Servo)}
    limits, gear, mode = keys["limits"], keys["gear"], keys["mode"]
    assert (limits.type, limits.unit, limits.default) == ("[lower, upper]", "rad", "**required**")
    assert (gear.type, gear.unit, gear.default) == ("number above 0", "", "`1`")
    assert mode.default == "`position`" and "or `current_based_position`" in mode.type
    assert {key.name: key.default for key in keys_of_model(ProfileFrame)}["quat"] == "`[1, 0, 0, 0]`"
    assert {key.name: key.default for key in keys_of_model(Bus)}["watchdog_s"] == "absent"
    assert {key.name: key.default for key in keys_of_model(PathPoint)}["time"] == "**required**"
    assert "from" in {key.name for key in keys_of_model(Obstacle)}


def test_own_keys_come_before_those_of_every_task() -> None:
    names = [key.name for key in keys_of_model(PositionTask)]
    assert names[:4] == ["type", "of", "weight", "per"] and set(names[4:]) == {"gain", "max_error", "optional", "when"}


def test_a_section_is_a_table_of_five_columns() -> None:
    lines = [line for line in section(Servo).splitlines() if line.startswith("|")]
    assert len(lines) == 2 + len(Servo.model_fields)
    assert {line.replace("\\|", "").count("|") for line in lines} == {6}


# The page of the command line: every command, every option, as `--help` has them.


def test_every_option_is_documented_with_its_meaning() -> None:
    page = command_page()
    for words, command in commands():
        assert (command.help or "").strip().splitlines()[0] in page, words
        for one in command.params:
            if one.param_type_name == "option" and one.name != "help":
                assert one.help, f"{words} {one.opts}"
                assert f"| `{one.opts[0]}" in page, f"{words} {one.opts}"
