"""A performer file: which sensors a person wears, and where. `configs/performers/*.yaml`."""

from pathlib import Path
from typing import Annotated

from pydantic import Field

from retarget.errors import Problem
from retarget.frames import JOINTS, SENSORS
from retarget.schema.catalogue import Kind, read_as
from retarget.schema.strict_models import Name, Schema, Switch, Text, unknown_name, validated
from retarget.schema.strict_yaml import Document

HELD = ("head", "l_wrist", "r_wrist")
"""Sensors that may sit beside their joints: a cap or headset, and controllers, which turn with head and hands."""


class PerformerSensor(Schema):
    """A sensor and the joint of the human that it sits on."""

    joint: Name
    """Human joint that it sits on."""
    orientation: Switch = False
    """Whether its orientation is used, where the source has one."""
    role: Text | None = None
    """Its name at a live sender, where the convention of roles does not give it."""
    beside: Switch = False
    """It sits some centimetres beside its joint; where is found out while a live performer stands still (head and
    wrists)."""


class Performer(Schema):
    """A performer: their sensors, in the order of the sample's rows."""

    name: Name
    """By which it is chosen."""
    description: Text
    """One line for lists."""
    roles: Name | None = None
    """Convention of a live sender's names (docs/live.md), where the kind of stream does not say so."""
    partial: Switch = False
    """A sensor that a live stream does not have takes no part, instead of being waited for."""
    sensors: Annotated[dict[Name, PerformerSensor], Field(min_length=1, max_length=64)]
    """Sensors on the performer, by canonical name."""

    @property
    def oriented(self) -> tuple[str, ...]:
        """Sensors whose orientation is used."""
        return tuple(name for name, sensor in self.sensors.items() if sensor.orientation)


def load_performer(path_or_name: str | Path) -> Performer:
    """A performer by shipped or user's name, or by path. Raises UsageError, ConfigError with all its problems."""
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
