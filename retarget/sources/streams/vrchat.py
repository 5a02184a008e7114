"""VRChat's OSC trackers (docs.vrchat.com, OSC Trackers): eight trackers and the head.

`/tracking/trackers/N/position` and `.../rotation`, N from 1 to 8 or `head`; Unity's axes, metres, Euler angles in
degrees; no times and no frame numbers. Senders number body parts differently: see `live/roles.py`.
"""

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retarget.rotations import Vector, axis_turn, product
from retarget.sources.streams.osc import UNKNOWN_ADDRESS, Number, OscLayouts, OscNumbers, OscPacket
from retarget.sources.streams.stream_frame import CONVENTIONS, MAX_COORDINATE, SENT_TWICE, Dropped, StreamFrame
from retarget.types import BoolArray, FloatArray

NOT_A_TRACKER = "tracker that is none of 1 to 8 and head"
WRONG_ARGUMENTS = "VRChat message with too few arguments or of the wrong types"
BAD_POSITION = "position that is not finite or far away"
BAD_ROTATION = "Euler angle that is not finite or beyond 100 turns"

MAX_DEGREES = 36_000.0
"""Largest angle, degrees: beyond, single precision does not resolve a hundredth of a degree."""

_UNITY = CONVENTIONS["unity"]
_X: Vector = (1.0, 0.0, 0.0)
_Y: Vector = (0.0, 1.0, 0.0)
_Z: Vector = (0.0, 0.0, 1.0)
"""Axes of Unity."""
_PREFIX = "/tracking/trackers/"
_IDS = frozenset([*"12345678", "head"])


@dataclass(frozen=True, slots=True, eq=False)
class _TrackerPlan:
    """Places of the numbers in one layout: n triples, positions first. rows (n,): of a frame. limits (n, 1): largest
    magnitudes."""

    names: tuple[str, ...]
    positions: int
    rows: NDArray[np.intp]
    numbers: OscNumbers
    limits: FloatArray
    reasons: Counter[str]


class VrchatDecoder:
    """A `StreamDecoder` of one sender's datagrams, each decoded by itself. A position or rotation that is not sent is
    NaN. Trackers of other ids are dropped: SlimeVR also sends head and hands as -1."""

    def __init__(self) -> None:
        self.dropped = Dropped()
        self._layouts = OscLayouts(_plan)

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The frame of one datagram; none if it has no tracker."""
        plan = self._layouts.of(datagram)
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
        # Unity rotates about fixed axes z, then x, then y: q = q_y q_x q_z (docs.unity3d.com, Quaternion.Euler).
        turns = [
            product(product(axis_turn(_Y, y), axis_turn(_X, x)), axis_turn(_Z, z))
            for x, y, z in np.radians(degrees).tolist()
        ]
        orientation[turned] = _UNITY.orientations(np.array(turns).reshape(-1, 4))
        return [StreamFrame(plan.names, position, orientation, tracked)]


def _plan(packet: OscPacket) -> _TrackerPlan:
    """Places of the numbers, and reasons for dropped messages, for all datagrams of this layout."""
    reasons = Counter(packet.dropped)
    names: dict[str, int] = {}
    positions: dict[int, tuple[Number, ...]] = {}
    rotations: dict[int, tuple[Number, ...]] = {}
    for message in packet.messages:
        tracker, _, quantity = message.address.removeprefix(_PREFIX).partition("/")
        if not message.address.startswith(_PREFIX) or quantity not in ("position", "rotation"):
            reasons[UNKNOWN_ADDRESS] += 1
        elif tracker not in _IDS:
            reasons[NOT_A_TRACKER] += 1
        elif not (numbers := message.numbers(0, 3)):
            reasons[WRONG_ARGUMENTS] += 1
        else:
            row = names.setdefault(f"tracker://{tracker}", len(names))
            places = positions if quantity == "position" else rotations
            if row in places:
                reasons[SENT_TWICE] += 1
            places[row] = numbers
    rows = np.array([*positions, *rotations], np.intp)
    sent = OscNumbers(number for places in (positions, rotations) for three in places.values() for number in three)
    limits = np.repeat([MAX_COORDINATE, MAX_DEGREES], [len(positions), len(rotations)])[:, None]
    return _TrackerPlan(tuple(names), len(positions), rows, sent, limits, reasons)
