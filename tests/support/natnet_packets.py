"""NatNet packets made from the documented layout alone: shares no code and no table with the reader under test."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from struct import pack
from typing import Literal

import numpy as np

from retarget.frames import SensorFrames
from retarget.sources.streams.natnet_wire import MessageId, Version, message, split
from retarget.types import FloatArray

PLAIN_VERSIONS = (Version(3, 0), Version(3, 1), Version(4, 0))
SIZED_VERSIONS = (Version(4, 1), Version(4, 2), Version(4, 3), Version(4, 4))
VERSIONS = PLAIN_VERSIONS + SIZED_VERSIONS

Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True)
class Pose:
    """As on the wire: xyzw, the server's axes."""

    number: int
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: Quaternion = (0.0, 0.0, 0.0, 1.0)
    flags: int = 1

    def packed(self) -> bytes:
        return pack("<i3f4ffh", self.number, *self.position, *self.turn, 0.25, self.flags)


@dataclass(frozen=True)
class Motion:
    """The content of a frame. surplus: bytes of an unknown kind at the end of blocks that carry their size."""

    number: int = 7
    bodies: Sequence[Pose] = ()
    skeletons: Sequence[tuple[int, Sequence[Pose]]] = ()
    assets: Sequence[tuple[int, Sequence[Pose]]] = ()
    timestamp: float = 12.5
    ticks: tuple[int, int, int] = (3_000_000, 3_100_000, 3_200_000)
    flags: int = 0
    surplus: bytes = b""
    tail: bytes = b""
    crowd: bool = True
    """Markers, force plates and devices between the poses."""
    end: bytes = field(default=b"\0\0\0\0")


def datagram(kind: int, payload: bytes) -> bytes:
    return pack("<HH", kind, len(payload)) + payload


def frame(motion: Motion, version: Version) -> bytes:
    """A whole datagram."""
    sized = version >= (4, 1)
    crowd = motion.crowd
    blocks = [
        (2, b"all\0" + pack("<I", 1) + bytes(12) + b"Quad\0" + pack("<I", 2) + bytes(24)) if crowd else (0, b""),
        (3, bytes(36)) if crowd else (0, b""),
        (len(motion.bodies), b"".join(pose.packed() for pose in motion.bodies)),
        (len(motion.skeletons), b"".join(pack("<i", number) + _poses(bones) for number, bones in motion.skeletons)),
    ]
    if sized:
        markers = pack("<I", 2) + bytes(2 * 26)
        blocks.append(
            (
                len(motion.assets),
                b"".join(pack("<i", number) + _poses(bones) + markers for number, bones in motion.assets),
            )
        )
    channels = pack("<iI", 1, 2) + pack("<I2f", 2, 1.0, 2.0) + pack("<I", 0)
    blocks += [(2, bytes(52)), (1, channels), (2, 2 * channels)] if crowd else 3 * [(0, b"")]
    body = b"".join(_block(count, content, motion.surplus if sized else None) for count, content in blocks)
    suffix = pack("<IIdQQQ", 0, 0, motion.timestamp, *motion.ticks)
    suffix += pack("<II", 1_700_000_000, 2**31) if sized else b""
    suffix += pack("<h", motion.flags) + motion.end
    return datagram(7, pack("<I", motion.number) + body + suffix + motion.tail)


def _poses(bones: Sequence[Pose]) -> bytes:
    return pack("<I", len(bones)) + b"".join(bone.packed() for bone in bones)


def _block(count: int, content: bytes, surplus: bytes | None) -> bytes:
    if surplus is None:
        return pack("<I", count) + content
    return pack("<II", count, len(content) + len(surplus)) + content + surplus


@dataclass(frozen=True)
class Body:
    """A definition."""

    name: str
    number: int
    parent: int = -1
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    markers: int = 2

    def packed(self, version: Version) -> bytes:
        out = self.name.encode() + b"\0" + pack("<ii3f", self.number, self.parent, *self.offset)
        if version >= (4, 2):
            out += pack("<4f", 0.0, 0.0, 0.0, 1.0)
        out += pack("<I", self.markers) + bytes(16 * self.markers)
        return out + b"marker\0" * self.markers if version >= (4, 0) else out


@dataclass(frozen=True)
class Catalogue:
    """The content of the definitions. surplus: as in `Motion`."""

    bodies: Sequence[Body] = ()
    skeletons: Sequence[tuple[str, int, Sequence[Body]]] = ()
    assets: Sequence[tuple[str, int, Sequence[Body]]] = ()
    surplus: bytes = b""
    crowd: bool = True
    """Marker sets, a force plate and a device; cameras from 4.0, an unknown kind from 4.1."""


def definitions(catalogue: Catalogue, version: Version) -> bytes:
    """A whole datagram."""
    sets = [(1, body.packed(version)) for body in catalogue.bodies]
    for name, number, bones in catalogue.skeletons:
        sets.append((2, name.encode() + b"\0" + pack("<i", number) + _bodies(bones, version)))
    if version >= (4, 1):
        for name, number, bones in catalogue.assets:
            head = name.encode() + b"\0" + pack("<ii", 1, number)
            sets.append((6, head + _bodies(bones, version) + pack("<I", 1) + b"m\0" + bytes(22)))
    if catalogue.crowd:
        sets = [(0, b"all\0" + pack("<I", 2) + b"one\0two\0"), *sets]
        sets.append((3, pack("<i", 1) + b"serial\0" + bytes(20 + 576 + 48 + 8) + pack("<I", 1) + b"Fx\0"))
        sets.append((4, pack("<i", 1) + b"device\0serial\0" + bytes(8) + pack("<I", 2) + b"a\0b\0"))
        if version >= (4, 0):
            sets.append((5, b"camera\0" + bytes(28)))
        if version >= (4, 1):
            sets.append((99, b"unknown kind"))
    out = pack("<I", len(sets))
    for kind, content in sets:
        if version >= (4, 1):
            content += catalogue.surplus
            out += pack("<II", kind, len(content)) + content
        else:
            out += pack("<I", kind) + content
    return datagram(5, out)


def _bodies(bones: Sequence[Body], version: Version) -> bytes:
    return pack("<I", len(bones)) + b"".join(bone.packed(version) for bone in bones)


def server_info(
    version: Version, *, clock_hz: int = 1_000_000, multicast: bool = False, port: int = 1511, name: bytes = b"Motive"
) -> bytes:
    """A whole datagram, with the leftovers behind the name that real servers send."""
    out = (name + b"\0ib\0").ljust(256, b"\xee") + bytes((3, 1, 0, 0)) + bytes((version.major, version.minor, 0, 0))
    return datagram(1, out + pack("<QHB4B", clock_hz, port, multicast, 239, 255, 42, 99))


ANN = 5 << 16
"""Of the first skeleton: its number as bones have it."""
CATALOGUE = Catalogue(
    bodies=[Body("Quad", 2), Body("Held", -3, markers=0)],
    skeletons=[
        ("Ann", 5, [Body("Hip", 1, 0, (0, 1, 0)), Body("Spine", 2, 1, (0, 0.5, 0), markers=0), Body("Head", 3, 2)]),
        ("Empty", 6, []),
    ],
    assets=[("Cloth", 8, [Body("Patch", 1)])],
)
MOTION = Motion(
    bodies=[Pose(2, (1, 2, 3), (0.1, 0.7, 0.1, 0.7)), Pose(3, (4, 5, 6), flags=0)],
    skeletons=[(5, [Pose(ANN | bone, (0, 1, 0), (0.5**0.5, 0, 0, 0.5**0.5)) for bone in (3, 1, 2)]), (6, [])],
    assets=[(8, [Pose(8 << 16 | 1, (9, 9, 9))])],
)


# A Motive server without cameras: answers NatNet questions and streams a recorded or made motion as rigid bodies.

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
