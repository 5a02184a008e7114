"""VRChat's OSC trackers (docs.vrchat.com, OSC Trackers), the receiving side: eight trackers and the head.

`/tracking/trackers/N/position` and `.../rotation`, N 1 to 8 or `head`; Unity's axes, metres, Euler angles in degrees.
Names of a frame: `tracker://1` to `tracker://8`, `tracker://head`. The stream has no time and no frame numbers. Each
sender numbers the body parts in its own way: `live/roles.py` has SlimeVR's.
"""

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retarget.rotations import Vector, axis_turn, product
from retarget.sources.streams.osc import Number, OscLayouts, OscMessage, OscNumbers, OscPacket
from retarget.sources.streams.stream_frame import CONVENTIONS, MAX_COORDINATE, Dropped, StreamFrame
from retarget.types import BoolArray, FloatArray

UNKNOWN_ADDRESS = "OSC address that is not used"
NOT_A_TRACKER = "tracker that is none of 1 to 8 and head"
WRONG_ARGUMENTS = "VRChat message with too few arguments or of the wrong types"
SENT_TWICE = "pose sent twice in one datagram"
BAD_POSITION = "position that is not finite or far away"
BAD_ROTATION = "Euler angle that is not finite or beyond 100 turns"

MAX_DEGREES = 36_000.0
"""Largest angle, degrees: a larger one of single precision does not resolve a hundredth of a degree."""

_UNITY = CONVENTIONS["unity"]
_X: Vector = (1.0, 0.0, 0.0)
_Y: Vector = (0.0, 1.0, 0.0)
_Z: Vector = (0.0, 0.0, 1.0)
"""Axes of Unity, about which VRChat turns by its Euler angles: z, then x, then y."""
_PREFIX = "/tracking/trackers/"
_IDS = frozenset([*"12345678", "head"])


@dataclass(frozen=True, slots=True, eq=False)
class _Plan:
    """Where one layout has its numbers: three of each of n triples, positions first, then rotations, with their rows of
    a frame (n,), and how large they may be (n, 1)."""

    names: tuple[str, ...]
    positions: int
    rows: NDArray[np.intp]
    numbers: OscNumbers
    limits: FloatArray
    reasons: Counter[str]


class VrchatDecoder:
    """A `StreamDecoder` of one sender's datagrams, each decoded by itself.

    A tracker without a rotation in the datagram has an orientation of NaN; one without a position has a position of
    NaN. SlimeVR also sends head and hands under the id -1: these are counted and not used.
    """

    def __init__(self) -> None:
        self.dropped = Dropped()
        self._layouts = OscLayouts(_plan)

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The frame of one datagram; none if it has no tracker."""
        plan = self._layouts.of(datagram)
        if plan.reasons:
            self.dropped.reasons.update(plan.reasons)
        if not plan.names:
            return []
        tracked = np.ones(len(plan.names), bool)
        position = np.full((len(plan.names), 3), np.nan)
        orientation = np.full((len(plan.names), 4), np.nan)
        placed, turned = plan.rows[: plan.positions], plan.rows[plan.positions :]
        triples = plan.numbers.read(datagram).reshape(-1, 3)
        bad: BoolArray = np.asarray(~(np.abs(triples) <= plan.limits).all(axis=1))
        if bad.any():
            reasons = np.where(np.arange(len(bad)) < plan.positions, BAD_POSITION, BAD_ROTATION)
            self.dropped.reasons.update(reasons[bad].tolist())
            triples[bad] = np.nan
            tracked[plan.rows[bad]] = False
        metres, degrees = triples[: plan.positions], triples[plan.positions :]
        position[placed] = _UNITY.positions(metres)
        # Unity turns by z, then x, then y, about fixed axes: q = q_y q_x q_z (docs.unity3d.com, Quaternion.Euler).
        turns = [
            product(product(axis_turn(_Y, y), axis_turn(_X, x)), axis_turn(_Z, z))
            for x, y, z in np.radians(degrees).tolist()
        ]
        orientation[turned] = _UNITY.orientations(np.array(turns).reshape(-1, 4))
        return [StreamFrame(plan.names, position, orientation, tracked)]


def _plan(packet: OscPacket) -> _Plan:
    """Where the numbers are, and what is dropped. The plan holds for every datagram of this layout."""
    reasons = Counter(packet.dropped)
    names: dict[str, int] = {}
    positions: dict[int, tuple[Number, ...]] = {}
    rotations: dict[int, tuple[Number, ...]] = {}
    for message in packet.messages:
        reason, tracker, what = _kind(message)
        if reason:
            reasons[reason] += 1
            continue
        row = names.setdefault(f"tracker://{tracker}", len(names))
        places = positions if what == "position" else rotations
        if row in places:
            reasons[SENT_TWICE] += 1
        places[row] = message.numbers(0, 3)
    rows = np.array([*positions, *rotations], np.intp)
    numbers = OscNumbers(number for places in (positions, rotations) for three in places.values() for number in three)
    limits = np.repeat([MAX_COORDINATE, MAX_DEGREES], [len(positions), len(rotations)])[:, None]
    return _Plan(tuple(names), len(positions), rows, numbers, limits, reasons)


def _kind(message: OscMessage) -> tuple[str, str, str]:
    """Why a message is not used ("" if it is), its tracker, and "position" or "rotation"."""
    tracker, _, what = message.address.removeprefix(_PREFIX).partition("/")
    if not message.address.startswith(_PREFIX) or what not in ("position", "rotation"):
        return UNKNOWN_ADDRESS, "", ""
    if tracker not in _IDS:
        return NOT_A_TRACKER, "", ""
    if not message.numbers(0, 3):
        return WRONG_ARGUMENTS, "", ""
    return "", tracker, what
