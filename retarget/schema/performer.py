"""A performer file: the sensors of a person. `configs/performers/*.yaml`."""

from pathlib import Path
from typing import Annotated

from pydantic import Field

from retarget.errors import Problem
from retarget.frames import JOINTS, SENSORS
from retarget.schema.catalogue import Kind, read_as
from retarget.schema.strict_models import Name, Schema, Switch, Text, unknown_name, validated
from retarget.schema.strict_yaml import Document

HELD = ("head", "l_wrist", "r_wrist")
"""Sensors that may be beside their joints: a cap or headset, and controllers."""


class PerformerSensor(Schema):
    """A sensor and its joint of the human."""

    joint: Name
    """Human joint of the sensor."""
    orientation: Switch = False
    """True to use its orientation, if the source has one."""
    role: Text | None = None
    """Its name at a live sender, if the convention of roles lacks it."""
    beside: Switch = False
    """It is some centimetres beside its joint; the offset is measured while a live performer stands still."""


class Performer(Schema):
    """A performer: their sensors, in the order of the sample's rows."""

    name: Name
    """Name by which it is chosen."""
    description: Text
    """One line for lists."""
    roles: Name | None = None
    """Convention of a live sender's names (docs/live.md), if the stream has none."""
    partial: Switch = False
    """A sensor that a live stream lacks takes no part, instead of being waited for."""
    sensors: Annotated[dict[Name, PerformerSensor], Field(min_length=1, max_length=64)]
    """Sensors on the performer, by canonical name."""

    @property
    def oriented(self) -> tuple[str, ...]:
        """Sensors whose orientation is used."""
        return tuple(name for name, sensor in self.sensors.items() if sensor.orientation)


def load_performer(path_or_name: str | Path) -> Performer:
    """A performer by name or path. Raises UsageError, ConfigError with all its problems."""
    return validated(Performer, read_as(Kind.PERFORMER, path_or_name), check=_check)


def _check(performer: Performer, document: Document) -> list[Problem]:
    problems = []
    first: dict[str, str] = {}
    for name, sensor in performer.sensors.items():
        if name not in SENSORS:
            problems.append(unknown_name(document, ("sensors", name), "sensor", name, SENSORS))
        if sensor.joint not in JOINTS:
            problems.append(unknown_name(document, ("sensors", name, "joint"), "joint", sensor.joint, JOINTS))
        if sensor.beside and name not in HELD:
            here, allowed = ("sensors", name, "beside"), ", ".join(HELD)
            problems.append(document.problem(here, "only these may sit beside their joints", allowed=allowed))
        earlier = first.setdefault(sensor.joint, name)
        if earlier != name:
            found = f"{sensor.joint}, which {earlier} sits on"
            problems.append(document.problem(("sensors", name, "joint"), "two sensors on one joint", found=found))
    return problems
