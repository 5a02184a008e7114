"""A performer file: which sensors a person wears, and where. `configs/performers/*.yaml`."""

from pathlib import Path
from typing import Annotated

from pydantic import Field

from retarget.catalogue import Kind, find
from retarget.errors import Problem
from retarget.frames import JOINTS, SENSORS
from retarget.schema import Name, Schema, Switch, Text, read_model
from retarget.schema_errors import unknown_name
from retarget.strict_yaml import Document

__all__ = ["HELD", "Performer", "WornSensor", "load_performer"]


HELD = ("head", "l_wrist", "r_wrist")
"""Sensors that may sit beside their joints: a cap or headset, and controllers, which turn with head and hands."""


class WornSensor(Schema):
    """A sensor and the joint of the human that it sits on. orientation: used where the source knows it.

    role: what a live sender calls it, where the sender's convention does not say so already. beside: it sits some
    centimetres beside its joint, and where is to be found out while a live performer stands still.
    """

    joint: Name
    orientation: Switch = False
    role: Text | None = None
    beside: Switch = False


class Performer(Schema):
    """A performer. `sensors`: canonical sensor name -> where it is worn, in the order of the sample's rows.

    roles: convention of a live sender's names (see `retarget.live.roles`), where the stream does not say so by its
    kind. partial: what a live stream lacks takes no part, instead of being waited for.
    """

    name: Name
    description: Text
    roles: Name | None = None
    partial: Switch = False
    sensors: Annotated[dict[Name, WornSensor], Field(min_length=1, max_length=64)]

    @property
    def oriented(self) -> tuple[str, ...]:
        """Sensors whose orientation is used."""
        return tuple(name for name, sensor in self.sensors.items() if sensor.orientation)


def load_performer(path_or_name: str | Path) -> Performer:
    """A performer by shipped or user's name, or by path. Raises UsageError, ConfigError with all its problems."""
    performer, _ = read_model(Performer, find(Kind.PERFORMER, path_or_name), check=_check)
    return performer


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
