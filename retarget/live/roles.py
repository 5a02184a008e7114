"""From a sender's poses to the sensors that a performer wears: which name is which sensor, by convention or by file."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from retarget import rotations
from retarget._solver import SensorPlan
from retarget.errors import Problem, UsageError, suggest
from retarget.frames import SENSORS, BoolArray
from retarget.performer import Performer
from retarget.rest_pose import REQUIRED
from retarget.rotations import FloatArray
from retarget.sources.mvn_roles import MVN_SENSORS
from retarget.sources.stream_frame import StreamFrame
from retarget.sources.vmc_roles import ROLE_SETS, Quaternion, Triple

__all__ = ["CONVENTIONS", "NO_WRISTS", "Place", "Roles", "SensorPoses", "roles_of"]

_UPRIGHT: Quaternion = (1.0, 0.0, 0.0, 0.0)
_NOWHERE: Triple = (0.0, 0.0, 0.0)
MAX_KNOWN = 64
"""Different sets of names that are remembered: a sender uses a few."""

Rows = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Place:
    """Where a sensor's pose comes from. position, orientation: the sender's names of poses, "" for none.

    rest: what the sender tells, wxyz, in the T-pose facing x. offset: from the joint to the point that is told, m, in
    the axes of that pose. loose: a thing that is worn or held beside the joint, which turns with what the joint
    carries; where exactly, the sender does not know.
    """

    position: str
    orientation: str = ""
    rest: Quaternion = _UPRIGHT
    offset: Triple = _NOWHERE
    loose: bool = False


def _of_role_set(name: str) -> dict[str, Place]:
    roles = ROLE_SETS[name].roles
    points = {role.point: role for role in roles if role.point}
    segments = {role.segment: role for role in roles if role.segment}
    found = {}
    for sensor in SENSORS:
        point, segment = points.get(sensor), segments.get(sensor)
        if point is not None:
            found[sensor] = Place(
                point.name,
                "" if segment is None else segment.name,
                _UPRIGHT if segment is None else segment.rest,
                point.offset,
            )
    return found


CONVENTIONS: dict[str, dict[str, Place]] = {
    "slimevr": _of_role_set("slimevr"),
    "slimevr_vrchat": _of_role_set("slimevr_vrchat"),
    "unity_bones": _of_role_set("unity_bones"),
    "mvn": {sensor: Place(role.position, role.orientation) for sensor, role in MVN_SENSORS.items()},
    "json": {sensor: Place(sensor, sensor) for sensor in SENSORS},
    "natnet": {},
}
"""Canonical sensor -> where a kind of sender tells it. NatNet's names are the user's own: the performer's file has
them."""


NO_WRISTS = "VRChat's trackers alone are not enough, they have no wrists: let the sender send VMC (vmc://:39539)"
_STEPS = {
    "slimevr_vrchat": NO_WRISTS,
    "natnet": "Motive's names are your own: --performer optitrack, or a copy of it with the names of your rigid bodies",
}
"""What to do about sensors that a sender of a convention does not tell."""
UNTOLD = Place("", "")
"""Of a sensor that a kind of sender does not know, and that is not waited for."""


@dataclass(frozen=True, slots=True, eq=False)
class SensorPoses:
    """What a frame says of m sensors. rows (m,): in the performer's order. position (m, 3) m, NaN where none;
    orientation (m, 4) wxyz, canonical, NaN where none; tracked (m,)."""

    rows: Rows
    position: FloatArray
    orientation: FloatArray
    tracked: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class _Plan:
    """How poses of certain names become sensors: rows (m,) of these, and from where in the frame they come."""

    rows: Rows
    columns: SensorPlan


class Roles:
    """The sensors of a performer in the poses of one sender."""

    def __init__(
        self, sensors: Sequence[str], places: Sequence[Place], *, convention: str = "", partial: bool = False
    ) -> None:
        """partial: what the sender lacks takes no part, and nobody waits for it."""
        self.sensors, self.places, self.convention = tuple(sensors), tuple(places), convention
        self.partial = partial
        self._plans: dict[tuple[str, ...], _Plan | None] = {}
        self._names: tuple[str, ...] = ()
        self._current: _Plan | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The sender's names that are listened for, each once."""
        return tuple(dict.fromkeys(name for one in self.places for name in (one.position, one.orientation) if name))

    @property
    def loose(self) -> tuple[str, ...]:
        """Sensors that sit beside their joints."""
        return tuple(sensor for sensor, place in zip(self.sensors, self.places, strict=True) if place.loose)

    def shifted(self, offset: FloatArray) -> "Roles":
        """The same with loose sensors known to be farther off: offset (k, 3) m, in canonical axes."""
        places = []
        for place, by in zip(self.places, offset, strict=True):
            x, y, z = (rotations.rotate(rotations.conjugate(place.rest), by) + place.offset).tolist()
            places.append(replace(place, offset=(x, y, z)) if place.loose else place)
        return Roles(self.sensors, places, convention=self.convention, partial=self.partial)

    def take(self, frame: StreamFrame) -> SensorPoses | None:
        """The sensors that a frame tells; None when it tells none."""
        plan = self._plan(frame.names)
        if plan is None:
            return None
        position, orientation = np.ascontiguousarray(frame.position), np.ascontiguousarray(frame.orientation)
        return SensorPoses(plan.rows, *plan.columns.read(position, orientation, frame.tracked))

    def _plan(self, names: tuple[str, ...]) -> _Plan | None:
        if names is not self._names:  # mostly it is the same tuple
            if names not in self._plans:
                if len(self._plans) >= MAX_KNOWN:
                    self._plans.clear()
                self._plans[names] = self._make(names)
            self._names, self._current = names, self._plans[names]
        return self._current

    def _make(self, names: tuple[str, ...]) -> _Plan | None:
        column = {name: index for index, name in enumerate(names) if name}  # "" is no name of a place
        told = [
            (row, place)
            for row, place in enumerate(self.places)
            if place.position in column or place.orientation in column
        ]
        if not told:
            return None
        columns = SensorPlan(
            len(names),
            points=np.array([column.get(place.position, -1) for _, place in told]),
            segments=np.array([column.get(place.orientation, -1) for _, place in told]),
            rest=rotations.conjugate([place.rest for _, place in told]),
            offset=np.array([place.offset for _, place in told]),
        )
        return _Plan(np.array([row for row, _ in told]), columns)


def roles_of(performer: Performer, convention: str, *, where: str) -> Roles:
    """The performer's sensors by a convention's names, or by those of the performer's file, which come first.

    where: the performer's file, for messages. Raises UsageError with every sensor that the sender cannot tell; one
    that takes what there is only for those that measure.
    """
    if convention not in CONVENTIONS:
        raise UsageError(
            "unknown convention of roles",
            where=where,
            found=repr(convention),
            allowed=", ".join(CONVENTIONS),
            next_step=suggest(convention, CONVENTIONS),
        )
    known, places, problems, lacking = CONVENTIONS[convention], list[Place](), list[Problem](), list[str]()
    for name, sensor in performer.sensors.items():
        place = known.get(name) if sensor.role is None else Place(sensor.role, sensor.role)
        if place is not None and (not sensor.beside or place.position == place.orientation):
            places.append(replace(place, loose=sensor.beside))
        elif place is not None:
            problems.append(
                Problem(
                    f"sender of kind {convention} does not tell how {name} turns",
                    f"{where}: sensors.{name}.beside",
                    next_step="Leave `beside` out",
                )
            )
        else:
            lacking.append(name)
            places.append(UNTOLD)
    if lacking and not (performer.partial and set(REQUIRED).isdisjoint(lacking)):
        problems.append(
            Problem(
                f"sender of kind {convention} tells no {', '.join(lacking)}",
                f"{where}: sensors",
                allowed=", ".join(known) or "no sensor by itself",
                next_step=_STEPS.get(convention, "Name the sender's pose with `role`, or leave the sensor out"),
            )
        )
    if problems:
        raise UsageError.from_problems(problems)
    return Roles(tuple(performer.sensors), places, convention=convention, partial=performer.partial)
