"""VRChat's OSC trackers (docs.vrchat.com, OSC Trackers), the receiving side: eight trackers and the head.

`/tracking/trackers/N/position` and `.../rotation`, N 1 to 8 or `head`; Unity's axes, metres, Euler angles in degrees.
Names of a frame: `tracker://1` to `tracker://8`, `tracker://head`. The stream has no time and no frame numbers. Each
sender numbers the body parts in its own way: `live/roles.py` has SlimeVR's.
"""

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retarget.sources.osc import OscLayouts, OscMessage, OscPacket
from retarget.sources.stream_frame import MAX_COORDINATE, Dropped, StreamFrame
from retarget.sources.vmc import euler_from_unity, position_from_unity
from retarget.types import BoolArray, FloatArray

UNKNOWN_ADDRESS = "OSC address that is not used"
NOT_A_TRACKER = "tracker that is none of 1 to 8 and head"
WRONG_ARGUMENTS = "VRChat message with too few arguments or of the wrong types"
SENT_TWICE = "pose sent twice in one datagram"
BAD_POSITION = "position that is not finite or far away"
BAD_ROTATION = "Euler angle that is not finite or beyond 100 turns"

MAX_DEGREES = 36_000.0
"""Beyond it, an angle of single precision does not resolve a hundredth of a degree."""

_PREFIX = "/tracking/trackers/"
_IDS = frozenset([*"12345678", "head"])


@dataclass(frozen=True, slots=True, eq=False)
class _Plan:
    """Where one layout has its numbers: the row of a frame and the words (n, 3) of positions, and of rotations."""

    names: tuple[str, ...]
    position_rows: NDArray[np.intp]
    positions: NDArray[np.intp]
    rotation_rows: NDArray[np.intp]
    rotations: NDArray[np.intp]
    reasons: Counter[str]


class VrchatDecoder:
    """A `StreamDecoder` of one sender's datagrams, each decoded by itself.

    A tracker without a rotation in the datagram has an orientation of NaN; one without a position has a position of
    NaN. SlimeVR also sends head and hands under the id -1: these are counted and not used.
    """

    def __init__(self) -> None:
        self.dropped = Dropped()
        self._layouts = OscLayouts(_plan)
        self._names: tuple[str, ...] = ()

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The frame of one datagram; none if it has no tracker."""
        plan = self._layouts.of(datagram)
        if plan.reasons:
            self.dropped.reasons.update(plan.reasons)
        if not plan.names:
            return []
        if plan.names != self._names:
            self._names = plan.names
        numbers = np.frombuffer(datagram, ">f4")
        tracked = np.ones(len(plan.names), bool)
        position = np.full((len(plan.names), 3), np.nan)
        orientation = np.full((len(plan.names), 4), np.nan)
        metres = self._triples(numbers, plan.positions, MAX_COORDINATE, BAD_POSITION, plan.position_rows, tracked)
        position[plan.position_rows] = position_from_unity(metres)
        degrees = self._triples(numbers, plan.rotations, MAX_DEGREES, BAD_ROTATION, plan.rotation_rows, tracked)
        orientation[plan.rotation_rows] = euler_from_unity(degrees)
        return [StreamFrame(self._names, position, orientation, tracked)]

    def _triples(
        self,
        numbers: NDArray[np.float32],
        words: NDArray[np.intp],
        limit: float,
        reason: str,
        rows: NDArray[np.intp],
        tracked: BoolArray,
    ) -> FloatArray:
        """The numbers (n, 3) at these words; an unusable triple becomes NaN, and its row is no longer tracked."""
        with np.errstate(invalid="ignore"):  # signalling NaNs from the wire
            triples = numbers.take(words).astype(np.float64)
        bad = ~(np.abs(triples) <= limit).all(axis=1)
        if bad.any():
            self.dropped.reasons[reason] += int(np.count_nonzero(bad))
            triples[bad] = np.nan
            tracked[rows[bad]] = False
        return triples


def _plan(packet: OscPacket) -> _Plan:
    """Where the numbers are, and what is dropped. The plan holds for every datagram of this layout."""
    reasons = Counter(packet.dropped)
    names: dict[str, int] = {}
    positions: dict[int, int] = {}
    rotations: dict[int, int] = {}
    for message in packet.messages:
        reason, tracker, what = _kind(message)
        if reason:
            reasons[reason] += 1
            continue
        row = names.setdefault(f"tracker://{tracker}", len(names))
        places = positions if what == "position" else rotations
        if row in places:
            reasons[SENT_TWICE] += 1
        places[row] = message.at[0] // 4
    return _Plan(tuple(names), *_columns(positions), *_columns(rotations), reasons)


def _kind(message: OscMessage) -> tuple[str, str, str]:
    """Why a message is not used ("" if it is), its tracker, and "position" or "rotation"."""
    tracker, _, what = message.address.removeprefix(_PREFIX).partition("/")
    if not message.address.startswith(_PREFIX) or what not in ("position", "rotation"):
        return UNKNOWN_ADDRESS, "", ""
    if tracker not in _IDS:
        return NOT_A_TRACKER, "", ""
    if not message.tags.startswith("fff"):
        return WRONG_ARGUMENTS, "", ""
    return "", tracker, what


def _columns(places: dict[int, int]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows (n,) and words (n, 3)."""
    first = np.array(list(places.values()), np.intp).reshape(len(places), 1)
    return np.array(list(places), np.intp), first + np.arange(3)
