"""Poses as JSON, one object per datagram: the project's own input, for any tracker with 20 lines of glue code.

    {"axes": "unity", "quaternion": "xyzw", "time": 12.345, "frame": 741,
     "poses": {"l_wrist": {"p": [0.1, 1.2, 0.3], "q": [0, 0, 0, 1], "tracked": true}, ...}}

or as an array in the order of a layout:

    {"axes": "openxr", "quaternion": "xyzw", "layout": "smpl24", "poses": [[0.1, 1.2, 0.3, 0, 0, 0, 1], null, ...]}

docs/live.md is the specification. An unknown, missing or doubled key, or a value of the wrong type, refuses the
datagram with a reason. Numbers that are no position or no rotation drop only their own pose.
"""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NoReturn

import numpy as np

from retarget import rotations
from retarget.frames import SENSORS
from retarget.sources.skeletons import SMPL_NAMES, TABLES, joints_by_name
from retarget.sources.streams.stream_frame import (
    CONVENTIONS,
    LEAST_SQUARE,
    MAX_COORDINATE,
    MAX_DATAGRAM,
    MAX_POSES,
    MOST_SQUARE,
    Dropped,
    StreamFrame,
)
from retarget.types import FloatArray

ORDERS = {"wxyz": (0, 1, 2, 3), "xyzw": (3, 0, 1, 2)}
"""Indices of w, x, y and z in a quaternion of this order."""

MAX_POSE_NAME = 64
"""Characters of the longest name of a pose."""
MAX_TIME = 1e11
MAX_FRAME = 2**63 - 1
"""Largest time, s (the year 5138), and frame number (a signed 64-bit integer)."""

_POSE_KEYS = {"p", "q", "tracked"}
NUMBER = frozenset((float, int))
_NOWHERE, _NO_TURN = (math.nan,) * 3, (math.nan,) * 4
"""Position and orientation that were not sent."""


@dataclass(frozen=True, eq=False)
class JsonLayout:
    """Poses that are sent as an array. count: of its poses. places (k): sensor -> its index. turned: True if rotations
    of joints are from a T-pose that faces forward; else they are not used."""

    count: int
    places: Mapping[str, int]
    turned: bool

    def orientations(self, sent: FloatArray) -> FloatArray:
        """Orientations (k, 4) of the sensors, unturned for hanging arms, from those sent (k, 4), REP-103."""
        return rotations.multiply(sent[self._rows], self._back) if self.turned else np.full_like(sent, np.nan)

    @cached_property
    def _rows(self) -> list[int]:
        """Row of each sensor's rotation: a toe turns with the foot."""
        names = [*self.places]
        return [names.index(name.replace("toe", "ankle")) for name in names]

    @cached_property
    def _back(self) -> FloatArray:
        """Rotations (k, 4) from a T-pose to hanging arms, 90 degrees about forward."""
        half = math.sqrt(0.5)
        hang = {
            name: half if name.startswith("l_") else -half
            for name in self.places
            if name[2:] in ("shoulder", "elbow", "wrist")
        }
        return np.array([(half, hang[name], 0.0, 0.0) if name in hang else rotations.IDENTITY for name in self.places])


_WEBXR: Mapping[str, int] = TABLES["webxr_83"]
_SMPL = {**(joints_by_name(SMPL_NAMES) or {}), "chest": SMPL_NAMES.index("spine3")}
LAYOUTS: Mapping[str, JsonLayout] = {
    "smpl24": JsonLayout(len(SMPL_NAMES), {name: _SMPL[name] for name in SENSORS if name in _SMPL}, turned=True),
    "webxr83": JsonLayout(83, {name: _WEBXR[name] for name in SENSORS if name in _WEBXR}, turned=False),
}
"""SMPL's order, also of PICO's body tracking, and WebXR's tracked body, whose rotations are not specified alike."""


class UnusableDatagram(ValueError):
    """A datagram that is not used; its text is the reason."""


class JsonPoseDecoder:
    """Implements StreamDecoder. Names of poses are the sender's; "l_wrist" and the like need no mapping."""

    def __init__(self) -> None:
        self.dropped = Dropped()
        self._names: tuple[str, ...] = ()

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The poses of one datagram. See `StreamDecoder`."""
        try:
            return [self._frame(read_object(datagram))]
        except UnusableDatagram as refused:
            self.dropped.note(str(refused))
            return []

    def _frame(self, message: dict[str, Any]) -> StreamFrame:
        if not message.keys() <= _KEYS:
            raise UnusableDatagram("a key other than axes, quaternion, layout, time, frame, poses")
        for key, is_usable, reason in _CHECKS:
            if (key in message or key in _REQUIRED) and not is_usable(message.get(key)):
                raise UnusableDatagram(reason)
        axes, order, poses = CONVENTIONS[message["axes"]], ORDERS.get(message.get("quaternion", "")), message["poses"]
        time, layout = message.get("time"), LAYOUTS.get(message.get("layout", ""))
        if layout is None and type(poses) is not dict:
            raise UnusableDatagram('"poses" is an array, and "layout" is missing')
        if layout is not None and (type(poses) is not list or len(poses) != layout.count):
            raise UnusableDatagram(f'"poses" is no array of the {layout.count} poses of {message["layout"]}')
        if layout is not None:
            poses = {name: poses[place] for name, place in layout.places.items()}
        places, turns, tracked = [], [], []
        for pose in poses.values() if layout is None else map(_of_array, poses.values()):
            place, turn, is_tracked = _pose(pose, order)
            bad = place is None or turn is None
            if bad and is_tracked:
                self.dropped.note("pose that is no number or no rotation")
            places.append(_NOWHERE if place is None or bad else place)
            turns.append(_NO_TURN if turn is None or bad else turn)
            tracked.append(is_tracked and not bad)
        names = tuple(poses)
        if names != self._names:  # checked when they change
            if not all(0 < len(name) <= MAX_POSE_NAME and name.isprintable() for name in names):
                raise UnusableDatagram(f"a pose's name is not of 1 to {MAX_POSE_NAME} printable characters")
            self._names = names
        orientation = axes.orientations(np.array(turns))
        return StreamFrame(
            names=self._names,
            position=axes.positions(np.array(places)),
            orientation=orientation if layout is None else layout.orientations(orientation),
            tracked=np.array(tracked),
            stamp=None if time is None else float(time),
            number=message.get("frame"),
        )


def read_object(datagram: bytes) -> dict[str, Any]:
    """The object of a datagram. Raises UnusableDatagram."""
    if len(datagram) > MAX_DATAGRAM:
        raise UnusableDatagram("datagram too long")
    try:
        message = _JSON.decode(datagram.decode("utf-8"))
    except UnusableDatagram:
        raise
    except (ValueError, RecursionError):  # not UTF-8, not JSON, a number of thousands of digits, brackets without end
        raise UnusableDatagram("not JSON in UTF-8") from None
    if type(message) is not dict:
        raise UnusableDatagram("not a JSON object")
    return message


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise UnusableDatagram("a key twice in an object")
    return found


def _no_constant(_: str) -> NoReturn:
    raise UnusableDatagram("NaN or Infinity: leave the pose out, or say tracked: false")


_JSON = json.JSONDecoder(object_pairs_hook=_object, parse_constant=_no_constant)
"""Made once: making it costs as much as a pose."""


TIME_IN_MS = '"time" is too large for seconds: it looks like milliseconds, or a smaller unit'
_CHECKS: tuple[tuple[str, Callable[[Any], bool], str], ...] = (
    ("axes", lambda name: type(name) is str and name in CONVENTIONS, '"axes" is missing or no known convention'),
    ("quaternion", lambda name: type(name) is str and name in ORDERS, '"quaternion" is neither "wxyz" nor "xyzw"'),
    (
        "layout",
        lambda name: type(name) is str and name in LAYOUTS,
        f'"layout" is none of {", ".join(LAYOUTS)}',
    ),
    ("time", lambda time: type(time) in (float, int) and abs(time) < math.inf, '"time" is no finite number of seconds'),
    ("time", lambda time: abs(time) <= MAX_TIME, TIME_IN_MS),
    ("frame", lambda number: type(number) is int and 0 <= number <= MAX_FRAME, '"frame" is no whole number from 0'),
    (
        "poses",
        lambda poses: type(poses) in (dict, list) and 0 < len(poses) <= MAX_POSES,
        f'"poses" is no object or array of 1 to {MAX_POSES} poses',
    ),
)
"""Key of a message, check of its value, and the reason of a refusal."""
_KEYS = {key for key, _, _ in _CHECKS}
_REQUIRED = {"axes", "poses"}


def _pose(pose: object, order: tuple[int, int, int, int] | None) -> tuple[Any, Any, bool]:
    """Position (3), quaternion (4) wxyz of norm 1, tracked. NaN if not sent, None if unusable."""
    if type(pose) is not dict or not pose.keys() <= _POSE_KEYS or not ("p" in pose or "q" in pose):
        raise UnusableDatagram('a pose is no object of "p", "q" or both, and "tracked"')
    tracked = pose.get("tracked", True)
    if type(tracked) is not bool:
        raise UnusableDatagram('"tracked" is neither true nor false')
    place: Any = _NOWHERE
    if "p" in pose:
        place = _numbers(pose["p"], 3)
        if not max(map(abs, place)) <= MAX_COORDINATE:
            place = None
    return place, _turn(pose["q"], order) if "q" in pose else _NO_TURN, tracked


_NO_POSE: dict[str, Any] = {"p": [math.nan] * 3, "tracked": False}
"""A pose of an array that is null."""


def _of_array(entry: object) -> object:
    """An entry of an array as a pose: 3 numbers, or 7 with a quaternion; null for none."""
    if entry is None:
        return _NO_POSE
    if type(entry) is list and len(entry) == 3:
        return {"p": entry}
    if type(entry) is list and len(entry) == 7:
        return {"p": entry[:3], "q": entry[3:]}
    return entry


def _turn(sent: object, order: tuple[int, int, int, int] | None) -> tuple[float, float, float, float] | None:
    if order is None:
        raise UnusableDatagram('"quaternion" (wxyz or xyzw) is missing')
    values = _numbers(sent, 4)
    w, x, y, z = (values[place] for place in order)
    if not max(abs(w), abs(x), abs(y), abs(z)) <= 2.0:  # before squares of large numbers
        return None
    square = w * w + x * x + y * y + z * z
    if not LEAST_SQUARE <= square <= MOST_SQUARE:
        return None
    norm = math.sqrt(square)
    return w / norm, x / norm, y / norm, z / norm


def _numbers(sent: object, count: int) -> list[Any]:
    if type(sent) is not list or len(sent) != count or not NUMBER.issuperset(map(type, sent)):
        raise UnusableDatagram('"p" is not 3 numbers or "q" not 4')
    return sent
