"""Roles: the sensors of the performer among a sender's poses, by its convention or the performer's file."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from retarget import rotations
from retarget._solver import SensorPlan
from retarget.errors import Problem, UsageError, suggest
from retarget.frames import REFLECT_POSITION, REFLECT_QUATERNION, SENSORS, mirrored_name
from retarget.human.rest_pose import REQUIRED
from retarget.live.advice import problem
from retarget.schema.performer import Performer
from retarget.sources.skeletons import TABLES, names_of_sides
from retarget.sources.streams.mvn import MVN_JOINTS
from retarget.sources.streams.stream_frame import StreamFrame
from retarget.types import BoolArray, FloatArray

Triple = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

_UPRIGHT: Quaternion = (1.0, 0.0, 0.0, 0.0)  # wxyz
_NOWHERE: Triple = (0.0, 0.0, 0.0)  # no offset
_HAND_FORWARD = (
    0.13  # [m] of SlimeVR's hand forward of the forearm's line, arms hanging (measured, default proportions)
)
MAX_NAME_SETS = 64  # sets of names that are kept: a sender uses a few

Rows = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class PoseSource:
    """The sender's poses of which a sensor's pose is made. position, orientation: names of poses, "" for none.

    standing: the sent orientation, wxyz, of a person who faces x and lets the arms hang, thumbs forward. offset: from
    the joint to the sent point, m, in that pose. loose: the sensor sits beside the joint at an unknown offset.
    """

    position: str
    orientation: str = ""
    standing: Quaternion = _UPRIGHT
    offset: Triple = _NOWHERE
    loose: bool = False

    def reflected(self) -> "PoseSource":
        """The same for the other side's sensor, in poses that are reflected left to right."""
        w, x, y, z = self.standing
        ahead, left, up = self.offset
        return replace(self, standing=(w, -x, y, -z), offset=(ahead, -left, up))


def _places(convention: str) -> dict[str, PoseSource]:
    sent = names_of_sides(TABLES["senders"][convention])
    both = {sensor: (names, names) if isinstance(names, str) else names for sensor, names in sent.items()}
    return {sensor: PoseSource(*both[sensor]) for sensor in SENSORS if sensor in both}


def _from_t_pose(places: dict[str, PoseSource]) -> dict[str, PoseSource]:
    half = float(np.sqrt(0.5))
    return places | {
        name: replace(places[name], standing=(half, turn, 0.0, 0.0))
        for side, turn in (("l", -half), ("r", half))
        for name in (f"{side}_shoulder", f"{side}_elbow", f"{side}_wrist")
    }


_SLIMEVR = _places("slimevr")
CONVENTIONS: dict[str, dict[str, PoseSource]] = {
    # SlimeVR's hand is a point in front of the grip. Calibration begins with the offset of the default proportions.
    "slimevr": _SLIMEVR
    | {wrist: replace(_SLIMEVR[wrist], offset=(_HAND_FORWARD, 0.0, 0.0)) for wrist in ("l_wrist", "r_wrist")},
    "slimevr_vrchat": _places("slimevr_vrchat"),
    "unity_bones": _from_t_pose(_places("unity_bones")),
    # The toe's segment bends at the ball of the foot; a toe sensor turns with the foot.
    "mvn": _from_t_pose(
        {sensor: PoseSource(MVN_JOINTS[sensor], MVN_JOINTS[sensor.replace("toe", "ankle")]) for sensor in SENSORS}
    ),
    "json": {sensor: PoseSource(sensor, sensor) for sensor in SENSORS},
    "natnet": {},
}
"""Sources by convention and canonical sensor. The performer's file has NatNet's names."""


NO_PLACE = PoseSource("", "")  # the source of a sensor that a sender lacks, and that is not waited for


@dataclass(frozen=True, slots=True, eq=False)
class SensorPoses:
    """The poses of m sensors in a frame, canonical. rows (m,): in the performer's order. position (m, 3) m, orientation
    (m, 4) wxyz, NaN for none."""

    rows: Rows
    position: FloatArray
    orientation: FloatArray
    tracked: BoolArray


class Roles:
    """The sensors of a performer in the poses of one sender."""

    def __init__(
        self,
        sensors: Sequence[str],
        places: Sequence[PoseSource],
        *,
        convention: str = "",
        partial: bool = False,
        mirrored: bool = False,
    ) -> None:
        """partial: sensors that the sender lacks are not waited for. mirrored: places are those of the other side."""
        self.sensors, self.places, self.convention = tuple(sensors), tuple(places), convention
        self.partial, self.mirrored = partial, mirrored
        self._plan = lru_cache(maxsize=MAX_NAME_SETS)(self._make)

    @property
    def names(self) -> tuple[str, ...]:
        """The sender's names of the used poses, each once."""
        return tuple(dict.fromkeys(name for one in self.places for name in (one.position, one.orientation) if name))

    @property
    def loose(self) -> tuple[str, ...]:
        """Sensors that sit beside their joints."""
        return tuple(sensor for sensor, place in zip(self.sensors, self.places, strict=True) if place.loose)

    def shifted(self, offset: FloatArray) -> "Roles":
        """These roles with the offsets of loose sensors increased by (k, 3) m, in canonical axes."""
        places = []
        for place, by in zip(self.places, offset, strict=True):
            x, y, z = (rotations.rotate(rotations.conjugate(place.standing), by) + place.offset).tolist()
            places.append(replace(place, offset=(x, y, z)) if place.loose else place)
        return Roles(self.sensors, places, convention=self.convention, partial=self.partial, mirrored=self.mirrored)

    def take(self, frame: StreamFrame) -> SensorPoses | None:
        """The sensors of a frame; None without any."""
        plan = self._plan(frame.names)
        if plan is None:
            return None
        position, orientation = np.ascontiguousarray(frame.position), np.ascontiguousarray(frame.orientation)
        if self.mirrored:
            position, orientation = position * REFLECT_POSITION, orientation * REFLECT_QUATERNION
        rows, columns = plan
        return SensorPoses(rows, *columns.read(position, orientation, frame.tracked))

    def _make(self, names: tuple[str, ...]) -> tuple[Rows, SensorPlan] | None:
        column = {name: index for index, name in enumerate(names) if name}  # "" is no name of a pose
        sent = [
            (row, place)
            for row, place in enumerate(self.places)
            if place.position in column or place.orientation in column
        ]
        if not sent:
            return None
        columns = SensorPlan(
            len(names),
            points=np.array([column.get(place.position, -1) for _, place in sent]),
            segments=np.array([column.get(place.orientation, -1) for _, place in sent]),
            turn=rotations.conjugate([place.standing for _, place in sent]),
            offset=np.array([place.offset for _, place in sent]),
        )
        return np.array([row for row, _ in sent]), columns


def roles_of(performer: Performer, convention: str, *, where: str, mirrored: bool = False) -> Roles:
    """The performer's sensors by the names of the performer's file, else by those of a convention.

    mirrored: the sender sees the performer in a mirror. Raises UsageError with every sensor that such a sender lacks;
    of a partial file, only with sensors that measuring needs.
    """
    if convention not in CONVENTIONS:
        allowed, step = ", ".join(CONVENTIONS), suggest(convention, CONVENTIONS)
        found = repr(convention)
        raise UsageError("unknown convention of roles", where=where, found=found, allowed=allowed, next_step=step)
    known, places, problems, missing = CONVENTIONS[convention], list[PoseSource](), list[Problem](), list[str]()
    standing = {place.orientation: place.standing for place in known.values()}
    for name, sensor in performer.sensors.items():
        sent = mirrored_name(name) if mirrored else name
        role = performer.sensors.get(sent, sensor).role
        place = known.get(sent) if role is None else PoseSource(role, role, standing.get(role, _UPRIGHT))
        place = place.reflected() if mirrored and place is not None else place
        if place is not None and (not sensor.beside or place.position == place.orientation):
            places.append(replace(place, loose=sensor.beside))
        elif place is not None:
            problems.append(problem("no orientation", f"{where}: sensors.{name}.beside", kind=convention, name=name))
        else:
            missing.append(name)
            places.append(NO_PLACE)
    if missing and not (performer.partial and set(REQUIRED).isdisjoint(missing)):
        facts = {"missing": ", ".join(missing), "known": ", ".join(known) or "no sensor by itself"}
        problems.append(problem("no such sensor", f"{where}: sensors", kind=convention, **facts))
    if problems:
        raise UsageError.from_problems(problems)
    return Roles(tuple(performer.sensors), places, convention=convention, partial=performer.partial, mirrored=mirrored)
