"""Roles: which pose of a sender is which sensor of the performer, by the sender's convention or by the performer's
file.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from retarget import rotations
from retarget._solver import SensorPlan
from retarget.errors import Problem, UsageError, suggest
from retarget.frames import SENSORS
from retarget.human.rest_pose import REQUIRED
from retarget.schema.performer import Performer
from retarget.sources.mvn import MVN_SENSORS
from retarget.sources.stream_frame import StreamFrame
from retarget.types import BoolArray, FloatArray

# The poses of VMC and VRChat trackers as data: their joint, their segment, their rest pose.
#
# Canonical orientations are the identity in the T-pose, standing upright, facing x. A sender whose rest pose has
# hanging arms sends turned arms in the T-pose: that turn is the role's `rest`.

Triple = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

_UPRIGHT: Quaternion = (1.0, 0.0, 0.0, 0.0)
_HALF_ROOT = float(np.sqrt(0.5))
_RAISED: dict[str, Quaternion] = {"l_": (_HALF_ROOT, _HALF_ROOT, 0.0, 0.0), "r_": (_HALF_ROOT, -_HALF_ROOT, 0.0, 0.0)}
"""A hanging arm turned to the T-pose: by 90 degrees about forward, the left one to the left."""


@dataclass(frozen=True, slots=True)
class Role:
    """One pose of a sender.

    name: the sender's, as in `StreamFrame.names`. point: the canonical sensor whose joint its position is, "" if none.
    segment: the canonical sensor whose body segment its rotation is, "" if none. rest: the orientation that is sent,
    wxyz, in the T-pose facing x. offset: from the joint to the point that is sent, m, in the axes of the sent rotation;
    of the sender's default proportions, where calibration begins.
    """

    name: str
    point: str
    segment: str
    rest: Quaternion = _UPRIGHT
    offset: Triple = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        assert {self.point, self.segment} <= {"", *SENSORS} and (self.point or self.segment)


_SIDES = (("l_", "Left"), ("r_", "Right"))

_HAND_FORWARD = 0.13
"""m by which SlimeVR's hand is forward of the forearm's line, arms hanging (measured, default proportions)."""

_SLIMEVR = (
    Role("human://HEAD", "head", "head"),
    Role("human://CHEST", "chest", "chest"),
    Role("human://WAIST", "pelvis", "pelvis"),
    *(
        role
        for short, side in _SIDES
        for role in (
            Role(f"human://{side.upper()}_KNEE", f"{short}knee", f"{short}hip"),
            Role(f"human://{side.upper()}_FOOT", f"{short}ankle", f"{short}ankle"),
            Role(f"human://{side.upper()}_ELBOW", f"{short}elbow", f"{short}shoulder", _RAISED[short]),
            Role(
                f"human://{side.upper()}_HAND",
                f"{short}wrist",
                f"{short}wrist",
                _RAISED[short],
                (_HAND_FORWARD, 0.0, 0.0),
            ),
        )
    ),
)
"""SlimeVR's sparse set. Knee and elbow: the joint, turned with the segment above it. Hand: a point in front of the
grip, beyond the wrist by a length that the stream does not hold; without a tracker there, it turns with the forearm.
SlimeVR sends roles without trackers too, so the performer's file must list those with trackers."""

_SLIMEVR_VRCHAT = (
    Role("tracker://head", "head", ""),
    Role("tracker://6", "chest", "chest"),
    Role("tracker://1", "pelvis", "pelvis"),
    *(
        Role(f"tracker://{number}", short + point, short + segment, _RAISED[short] if point == "elbow" else _UPRIGHT)
        for point, segment, numbers in (("ankle", "ankle", "23"), ("knee", "hip", "45"), ("elbow", "shoulder", "78"))
        for (short, _), number in zip(_SIDES, numbers, strict=True)
    ),
)
"""SlimeVR's fixed ids over VRChat OSC, same meaning as above. The head turns on a yaw reset only; no wrists."""

_BONES = (
    Role("bone://Head", "head", "head"),
    Role("bone://Chest", "chest", ""),
    Role("bone://UpperChest", "", "chest"),
    Role("bone://Hips", "pelvis", "pelvis"),
    *(
        Role(f"bone://{side}{bone}", short + sensor, short + sensor)
        for bone, sensor in (
            *(("UpperArm", "shoulder"), ("LowerArm", "elbow"), ("Hand", "wrist")),
            *(("UpperLeg", "hip"), ("LowerLeg", "knee"), ("Foot", "ankle"), ("Toes", "toe")),
        )
        for short, side in _SIDES
    ),
)
"""Unity's bones: the joint where the bone begins, and the bone; after forward kinematics (`VmcBodyDecoder`)."""

ROLE_SETS = {"slimevr": _SLIMEVR, "slimevr_vrchat": _SLIMEVR_VRCHAT, "unity_bones": _BONES}
"""The roles of one kind of sender, under the name that performers' files use."""

_NOWHERE: Triple = (0.0, 0.0, 0.0)
MAX_KNOWN = 64
"""Different sets of names that are kept: a sender uses a few."""

Rows = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Place:
    """Where a sensor's pose comes from. position, orientation: the sender's names of poses, "" for none.

    rest: the orientation that is sent, wxyz, in the T-pose facing x. offset: from the joint to the point that is sent,
    m, in the axes of that pose. loose: the sensor is worn or held beside the joint at an unknown offset, and turns with
    the segment of the joint.
    """

    position: str
    orientation: str = ""
    rest: Quaternion = _UPRIGHT
    offset: Triple = _NOWHERE
    loose: bool = False


def _of_role_set(name: str) -> dict[str, Place]:
    roles = ROLE_SETS[name]
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
"""Convention -> canonical sensor -> its place in the sender's poses. NatNet's names are the user's own: the performer's
file has them."""


NO_WRISTS = "VRChat's trackers alone are not enough, they have no wrists: let the sender send VMC (vmc://:39539)"
_STEPS = {
    "slimevr_vrchat": NO_WRISTS,
    "natnet": "Motive's names are your own: --performer optitrack, or a copy of it with the names of your rigid bodies",
}
"""The next step for sensors that a sender of a convention does not send."""
NO_PLACE = Place("", "")
"""The place of a sensor that a kind of sender does not have, and that is not waited for."""


@dataclass(frozen=True, slots=True, eq=False)
class SensorPoses:
    """The poses of m sensors in a frame. rows (m,): in the performer's order. position (m, 3) m, NaN where none;
    orientation (m, 4) wxyz, canonical, NaN where none; tracked (m,)."""

    rows: Rows
    position: FloatArray
    orientation: FloatArray
    tracked: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class _Plan:
    """How the poses of a set of names become sensors. rows (m,): of the sensors; columns: of the frame's poses."""

    rows: Rows
    columns: SensorPlan


class Roles:
    """The sensors of a performer in the poses of one sender."""

    def __init__(
        self, sensors: Sequence[str], places: Sequence[Place], *, convention: str = "", partial: bool = False
    ) -> None:
        """partial: sensors that the sender does not have take no part, and are not waited for."""
        self.sensors, self.places, self.convention = tuple(sensors), tuple(places), convention
        self.partial = partial
        self._plans: dict[tuple[str, ...], _Plan | None] = {}
        self._names: tuple[str, ...] = ()
        self._current: _Plan | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The sender's names of the poses that are used, each once."""
        return tuple(dict.fromkeys(name for one in self.places for name in (one.position, one.orientation) if name))

    @property
    def loose(self) -> tuple[str, ...]:
        """Sensors that sit beside their joints."""
        return tuple(sensor for sensor, place in zip(self.sensors, self.places, strict=True) if place.loose)

    def shifted(self, offset: FloatArray) -> "Roles":
        """These roles with the offsets of loose sensors increased by offset (k, 3) m, in canonical axes."""
        places = []
        for place, by in zip(self.places, offset, strict=True):
            x, y, z = (rotations.rotate(rotations.conjugate(place.rest), by) + place.offset).tolist()
            places.append(replace(place, offset=(x, y, z)) if place.loose else place)
        return Roles(self.sensors, places, convention=self.convention, partial=self.partial)

    def take(self, frame: StreamFrame) -> SensorPoses | None:
        """The sensors of a frame; None where it has none of them."""
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
            rest=rotations.conjugate([place.rest for _, place in sent]),
            offset=np.array([place.offset for _, place in sent]),
        )
        return _Plan(np.array([row for row, _ in sent]), columns)


def roles_of(performer: Performer, convention: str, *, where: str) -> Roles:
    """The performer's sensors by the names of the performer's file, or else by those of a convention.

    where: the performer's file, for messages. Raises UsageError with every sensor that such a sender does not have. Of
    a partial file, only the sensors that measuring needs are refused.
    """
    if convention not in CONVENTIONS:
        raise UsageError(
            "unknown convention of roles",
            where=where,
            found=repr(convention),
            allowed=", ".join(CONVENTIONS),
            next_step=suggest(convention, CONVENTIONS),
        )
    known, places, problems, missing = CONVENTIONS[convention], list[Place](), list[Problem](), list[str]()
    for name, sensor in performer.sensors.items():
        place = known.get(name) if sensor.role is None else Place(sensor.role, sensor.role)
        if place is not None and (not sensor.beside or place.position == place.orientation):
            places.append(replace(place, loose=sensor.beside))
        elif place is not None:
            problems.append(
                Problem(
                    f"sender of kind {convention} does not send the orientation of {name}",
                    f"{where}: sensors.{name}.beside",
                    next_step="Leave `beside` out",
                )
            )
        else:
            missing.append(name)
            places.append(NO_PLACE)
    if missing and not (performer.partial and set(REQUIRED).isdisjoint(missing)):
        problems.append(
            Problem(
                f"sender of kind {convention} sends no {', '.join(missing)}",
                f"{where}: sensors",
                allowed=", ".join(known) or "no sensor by itself",
                next_step=_STEPS.get(convention, "Name the sender's pose with `role`, or leave the sensor out"),
            )
        )
    if problems:
        raise UsageError.from_problems(problems)
    return Roles(tuple(performer.sensors), places, convention=convention, partial=performer.partial)
