"""Without which of a performer's sensors nobody is measured, and without which the robot does not move."""

from collections.abc import Iterable

import numpy as np

from retarget.errors import UsageError
from retarget.frames import BoolArray
from retarget.live.roles import NO_WRISTS, Roles
from retarget.live.stream import LiveStream
from retarget.rest_pose import REQUIRED

__all__ = ["carrying", "missing_sensors", "needed", "refuse_unmeasurable"]

CARRYING = ("pelvis", "l_ankle", "r_ankle")
"""Without one of these that is worn, the robot does not know how to stand."""
CARRYING_ALONE = ("head",)
"""What stands for them where none is worn: all that tells where the body is."""


def carrying(names: Iterable[str]) -> tuple[str, ...]:
    """Of these sensors, those without which the robot holds."""
    worn = tuple(names)
    return tuple(name for name in CARRYING if name in worn) or tuple(name for name in CARRYING_ALONE if name in worn)


def needed(roles: Roles) -> tuple[str, ...]:
    """Those of a performer that must be heard to begin: a file that takes what there is needs what measures only."""
    return tuple(dict.fromkeys((*REQUIRED, *(() if roles.partial else carrying(roles.sensors)))))


def missing_sensors(stream: LiveStream, now: float) -> list[str]:
    """Sensors to be waited for: those needed that are not fresh, and those listed that the stream does not have."""
    heard, must, roles = stream.read(now), needed(stream.roles), stream.roles
    known: BoolArray = np.asarray(np.isfinite(heard.position).all(axis=1))
    missing = []
    for name, place, fresh, told in zip(roles.sensors, roles.places, heard.fresh, known, strict=True):
        lacks = not (told or roles.partial or {place.position, place.orientation} & stream.names.keys())
        if lacks or (name in must and not fresh):
            missing.append(name)
    return missing


def refuse_unmeasurable(roles: Roles, *, where: str) -> None:
    """Raise UsageError where the performer's file lacks a sensor without which nobody can be measured."""
    lacking = [name for name in REQUIRED if name not in roles.sensors]
    if lacking:
        vrchat = roles.convention == "slimevr_vrchat"
        raise UsageError(
            "the performer cannot be measured without head and both wrists",
            where=where,
            found=f"a performer's file without {', '.join(lacking)}",
            next_step=NO_WRISTS if vrchat else "Add them to the performer's file, or choose another --performer",
        )
