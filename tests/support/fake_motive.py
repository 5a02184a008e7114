"""A Motive server without cameras: answers NatNet questions and streams a recorded or made motion as rigid bodies.

Datagrams in, datagrams out; no socket and no clock.
"""

from dataclasses import dataclass
from struct import pack
from typing import Literal

import numpy as np

from natnet_packets import Body, Catalogue, Motion, Pose, definitions, frame, server_info
from retarget.frames import SensorFrames
from retarget.sources.natnet_wire import MessageId, Version, message, split
from retarget.types import FloatArray

_USUAL = Version(4, 1)
_MAX_BURST_S = 1.0
"""Longest burst of missed frames, after a time without a call of `due`."""


@dataclass(frozen=True, slots=True)
class MotiveSettings:
    """How the server is set. version: of its bitstream.

    latency_s: from exposure to sending. patience_s: after which a silent unicast client is sent nothing more.
    clock_offset_s: what its clock said when ours said 0.
    """

    version: Version = _USUAL
    transport: Literal["unicast", "multicast"] = "unicast"
    up: Literal["y", "z"] = "y"
    clock_hz: int = 10_000_000
    clock_offset_s: float = 1000.0
    latency_s: float = 0.0055
    patience_s: float = 10.0


class FakeMotive:
    """One server, one client. Each sensor of the motion is a rigid body of its name; the motion repeats.

    May be changed at any time: streaming (Live or paused), answering (switched on at all). frames: sent so far.
    """

    def __init__(self, motion: SensorFrames, settings: MotiveSettings | None = None) -> None:
        assert motion.rate_hz, "the motion needs a rate"
        self.settings = settings or MotiveSettings()
        self.streaming = True
        self.answering = True
        self.frames = 0
        self._motion = motion
        self._rate_hz = float(motion.rate_hz)
        self._position, self._turn = _to_wire(motion, self.settings.up)
        self._names = list(motion.names)
        self._last_request: float | None = None
        self._next: int | None = None
        self._changed = False
        self._first_id = 1

    def rename(self, names: list[str], *, first_id: int = 1, announced: bool = True) -> None:
        """Give the same bodies other names and ids. announced: the next frame says that definitions changed."""
        assert len(names) == len(self._names)
        self._names, self._first_id = list(names), first_id
        self._changed = announced

    def receive(self, now: float, datagram: bytes) -> list[bytes]:
        """Answers to a datagram that came to the command port at `now` (s)."""
        parts = split(datagram)
        if parts is None or not self.answering:
            return []
        kind, payload = parts
        if kind in (MessageId.CONNECT, MessageId.DISCOVERY):
            if kind == MessageId.CONNECT:
                self._last_request = now
            return [self._server_info()]
        if kind == MessageId.DEFINITIONS_REQUEST:
            return [self._definitions()]
        if kind == MessageId.KEEP_ALIVE:
            self._last_request = now if self._last_request is not None else None
            return []
        if kind == MessageId.ECHO and len(payload) == 8:
            return [message(MessageId.ECHO_ANSWER, payload + pack("<Q", self._ticks(now)))]
        return [message(MessageId.UNRECOGNISED)]

    def due(self, now: float) -> list[bytes]:
        """The frames to send by `now`, to the client or the group."""
        newest = int((now - self.settings.latency_s) * self._rate_hz)
        first = newest if self._next is None else max(self._next, newest - int(_MAX_BURST_S * self._rate_hz))
        self._next = newest + 1
        if not (self.streaming and self.answering and self._has_client(now)):
            return []
        return [self._frame(index) for index in range(first, newest + 1)]

    def _has_client(self, now: float) -> bool:
        if self.settings.transport == "multicast":
            return True
        return self._last_request is not None and now - self._last_request <= self.settings.patience_s

    def _ticks(self, now: float) -> int:
        return round((now + self.settings.clock_offset_s) * self.settings.clock_hz)

    def _server_info(self) -> bytes:
        settings = self.settings
        multicast = settings.transport == "multicast"
        return server_info(settings.version, clock_hz=settings.clock_hz, multicast=multicast)

    def _definitions(self) -> bytes:
        bodies = [Body(name, number, markers=1) for number, name in enumerate(self._names, start=self._first_id)]
        return definitions(Catalogue(bodies, crowd=False), self.settings.version)

    def _frame(self, index: int) -> bytes:
        row = index % len(self._motion.time)
        columns = zip(self._position[row].tolist(), self._turn[row].tolist(), self._motion.valid[row], strict=True)
        bodies = [
            Pose(number, (x, y, z), (a, b, c, w), int(valid))
            for number, ((x, y, z), (a, b, c, w), valid) in enumerate(columns, start=self._first_id)
        ]
        exposed = index / self._rate_hz
        sent = exposed + self.settings.latency_s
        ticks = (self._ticks(exposed), self._ticks(0.5 * (exposed + sent)), self._ticks(sent))
        flags = 2 if self._changed else 0
        self._changed = False
        self.frames += 1
        motion = Motion(index % 2**32, bodies, timestamp=exposed, ticks=ticks, flags=flags, crowd=False)
        return frame(motion, self.settings.version)


def _to_wire(motion: SensorFrames, up: str) -> tuple[FloatArray, FloatArray]:
    """Positions (T, k, 3) and quaternions xyzw (T, k, 4) in Motive's axes; what is not known stands at the origin."""
    order = [1, 2, 0] if up == "y" else [0, 1, 2]
    position = np.nan_to_num(motion.position[..., order])
    known = np.isfinite(motion.orientation).all(axis=-1, keepdims=True)
    wxyz = np.where(known, motion.orientation, [1.0, 0.0, 0.0, 0.0])
    return position, np.concatenate([wxyz[..., 1:][..., order], wxyz[..., :1]], axis=-1)
