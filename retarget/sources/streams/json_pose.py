"""Poses as JSON, one object per datagram: this project's own input, for any tracker with 20 lines of glue code.

    {"axes": "unity", "quaternion": "xyzw", "time": 12.345, "frame": 741,
     "poses": {"l_wrist": {"p": [0.1, 1.2, 0.3], "q": [0, 0, 0, 1], "tracked": true}, ...}}

docs/live.md is the specification. It is strict, so that an error of a sender shows on the first datagram. An
unknown, missing or doubled key, or a value of the wrong type, refuses the datagram with a reason. Numbers that are no
position or no rotation drop only their own pose.
"""

import json
import math
from collections.abc import Callable
from typing import Any, NoReturn

import numpy as np

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

ORDERS = {"wxyz": (0, 1, 2, 3), "xyzw": (3, 0, 1, 2)}
"""Where w, x, y and z stand in a quaternion of this order."""

MAX_NAME = 64
"""Characters of the longest name of a pose."""
MAX_TIME = 1e11
MAX_FRAME = 2**63 - 1
"""Largest time, s (the year 5138), and frame (a signed 64-bit integer): larger ones are no counters."""

_POSE_KEYS = {"p", "q", "tracked"}
NUMBER = frozenset((float, int))
_NOWHERE, _NO_TURN = (math.nan,) * 3, (math.nan,) * 4
"""Position and orientation that were not sent."""


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
            raise UnusableDatagram("a key other than axes, quaternion, time, frame, poses")
        for key, is_usable, reason in _CHECKS:
            if (key in message or key in _REQUIRED) and not is_usable(message.get(key)):
                raise UnusableDatagram(reason)
        axes, order, poses = CONVENTIONS[message["axes"]], ORDERS.get(message.get("quaternion", "")), message["poses"]
        time = message.get("time")
        places, turns, tracked = [], [], []
        for pose in poses.values():
            place, turn, is_tracked = _pose(pose, order)
            bad = place is None or turn is None
            if bad and is_tracked:
                self.dropped.note("pose that is no number or no rotation")
            places.append(_NOWHERE if place is None or bad else place)
            turns.append(_NO_TURN if turn is None or bad else turn)
            tracked.append(is_tracked and not bad)
        names = tuple(poses)
        if names != self._names:  # they are checked when they change
            if not all(0 < len(name) <= MAX_NAME and name.isprintable() for name in names):
                raise UnusableDatagram(f"a pose's name is not of 1 to {MAX_NAME} printable characters")
            self._names = names
        return StreamFrame(
            names=self._names,
            position=axes.positions(np.array(places)),
            orientation=axes.orientations(np.array(turns)),
            tracked=np.array(tracked),
            stamp=None if time is None else float(time),
            number=message.get("frame"),
        )


def read_object(datagram: bytes) -> dict[str, Any]:
    """The object of a datagram, or UnusableDatagram."""
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
"""Made once: that costs as much as a pose."""


TIME_IN_MS = '"time" is too large for seconds: it looks like milliseconds, or a smaller unit'
_CHECKS: tuple[tuple[str, Callable[[Any], bool], str], ...] = (
    ("axes", lambda name: type(name) is str and name in CONVENTIONS, '"axes" is missing or no known convention'),
    ("quaternion", lambda name: type(name) is str and name in ORDERS, '"quaternion" is neither "wxyz" nor "xyzw"'),
    ("time", lambda time: type(time) in (float, int) and abs(time) < math.inf, '"time" is no finite number of seconds'),
    ("time", lambda time: abs(time) <= MAX_TIME, TIME_IN_MS),
    ("frame", lambda number: type(number) is int and 0 <= number <= MAX_FRAME, '"frame" is no whole number from 0'),
    (
        "poses",
        lambda poses: type(poses) is dict and 0 < len(poses) <= MAX_POSES,
        f'"poses" is no object of 1 to {MAX_POSES} poses',
    ),
)
"""Key of a message, what its value must be, and why the message is refused otherwise."""
_KEYS = {key for key, _, _ in _CHECKS}
_REQUIRED = {"axes", "poses"}


def _pose(pose: object, order: tuple[int, int, int, int] | None) -> tuple[Any, Any, bool]:
    """Position (3), quaternion (4) wxyz of norm 1, tracked. NaN for what is not sent, None for what is not usable."""
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
