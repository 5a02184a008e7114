"""Messages of OptiTrack NatNet 3.0 to 4.x: connect, server, commands, frames of data, model definitions.

All are little-endian: u16 id, u16 payload size, payload. A frame is a u32 number, then blocks in a fixed order
(`_BLOCKS`), each after a u32 count, then a suffix of stamps and flags. Definitions are a u32 count of sets, each after
its u32 type (`_SETS`). Since 4.1 a u32 size in bytes stands before the content of each block and set; unknown content
is skipped by it.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from enum import CONFORM, Enum, IntEnum, IntFlag
from typing import Any, NamedTuple, TypeAlias

import numpy as np

COMMAND_PORT = 1510
"""UDP port of the server for requests."""
DATA_PORT = 1511
"""UDP port of multicast frames."""

MAX_TEXT = 128
"""Characters of a name that are kept."""
CLIENT_NAME = b"retarget"
CLIENT_VERSION = bytes((3, 0, 0, 0))
"""Name and version of this client; 3.0 as in real captures."""

_HEADER = struct.Struct("<HH")
_SERVER = struct.Struct("<256s4s4sQHB4s")


class MessageId(IntEnum):
    """First word of a datagram."""

    CONNECT = 0
    SERVER_INFO = 1
    COMMAND = 2
    COMMAND_ANSWER = 3
    DEFINITIONS_REQUEST = 4
    DEFINITIONS = 5
    FRAME = 7
    TEXT = 8
    DISCONNECT = 9
    KEEP_ALIVE = 10
    ECHO = 12
    ECHO_ANSWER = 13
    DISCOVERY = 14
    UNRECOGNISED = 100


class Version(NamedTuple):
    """Version of the bitstream; versions compare as tuples do."""

    major: int
    minor: int

    def __str__(self) -> str:
        return f"{self.major}.{self.minor}"


@dataclass(frozen=True, slots=True)
class ServerInfo:
    """Answer of a server to connect. clock_hz: of its ticks (0: unknown). data_port and group: of multicast."""

    name: str
    app_version: tuple[int, int, int, int]
    version: Version
    clock_hz: int
    data_port: int
    multicast: bool
    group: str


def message(kind: MessageId, payload: bytes = b"") -> bytes:
    """A whole datagram: id, size of the payload, payload."""
    return _HEADER.pack(kind, len(payload)) + payload


def split(datagram: bytes) -> tuple[int, bytes] | None:
    """Id and payload; None if the datagram is shorter than its header says. Bytes after the payload are ignored."""
    if len(datagram) < 4:
        return None
    kind, size = _HEADER.unpack_from(datagram)
    if len(datagram) < 4 + size:
        return None
    return kind, datagram[4 : 4 + size]


def connect_message() -> bytes:
    """Request for a ServerInfo; a unicast server then sends its frames to the sender's port."""
    return message(MessageId.CONNECT, CLIENT_NAME.ljust(256, b"\0") + 2 * CLIENT_VERSION)


def read_server_info(payload: bytes) -> ServerInfo | None:
    """The answer to connect; None if it has less than 279 bytes."""
    if len(payload) < _SERVER.size:
        return None
    name, app, natnet, clock_hz, port, multicast, group = _SERVER.unpack_from(payload)
    return ServerInfo(
        name=text_until_zero(name),
        app_version=(app[0], app[1], app[2], app[3]),
        version=Version(natnet[0], natnet[1]),
        clock_hz=clock_hz,
        data_port=port,
        multicast=multicast != 0,
        group=".".join(str(part) for part in group),
    )


def text_until_zero(raw: bytes) -> str:
    """UTF-8 text up to the first NUL: wrong bytes are replaced, unprintable and surplus characters left out."""
    text = raw.partition(b"\0")[0][: 4 * MAX_TEXT].decode("utf-8", "replace")
    return "".join(letter for letter in text if letter.isprintable())[:MAX_TEXT]


OLDEST = Version(3, 0)
"""First bitstream that is read."""
SIZED_SINCE = Version(4, 1)
"""First bitstream whose blocks carry their sizes; trained assets came with it."""
_MARKERS_NAMED_SINCE = Version(4, 0)
_TURNED_SINCE = Version(4, 2)
"""First bitstream whose bodies are defined with a rotation."""
_LAYOUTS = (OLDEST, _MARKERS_NAMED_SINCE, SIZED_SINCE, _TURNED_SINCE)
"""First version of each layout of definitions."""

POSE_RECORD = np.dtype([("id", "<i4"), ("pose", "<f4", 7), ("error", "<f4"), ("flags", "<i2")])
"""One pose on the wire, 38 bytes: position m and quaternion xyzw, mean marker error m; bit 0 of flags: tracked."""


class _Text: ...


@dataclass(frozen=True, slots=True)
class _Counted:
    """A u32 count, then as many items."""

    item: "_Item"


_Item: TypeAlias = "int | _Text | _Counted | tuple[_Item, ...]"
"""Content that is skipped. A number is a size in bytes."""
_TEXT = _Text()


class Owner(Enum):
    """Owner of a group of poses."""

    RIGID_BODIES = "rigid"
    SKELETON = "bone"
    ASSET = "asset"


_POSITION, _LABELLED_MARKER = 12, 26
_FORCE_CHANNELS = (4, _Counted(_Counted(4)))
"""A force plate or device: id, channels of floats."""

_BLOCKS: tuple[tuple["Owner | _Item", Version], ...] = (
    ((_TEXT, _Counted(_POSITION)), OLDEST),  # marker sets
    (_POSITION, OLDEST),  # other markers
    (Owner.RIGID_BODIES, OLDEST),
    (Owner.SKELETON, OLDEST),
    (Owner.ASSET, SIZED_SINCE),
    (_LABELLED_MARKER, OLDEST),
    (_FORCE_CHANNELS, OLDEST),  # force plates
    (_FORCE_CHANNELS, OLDEST),  # devices
)
"""Blocks of a frame, and the version since which they exist. Poses are kept, other items are skipped. Records of one
size must fit the size of the block."""

_PLATE = 2 * 4 + 12 + 144 * 4 + 12 * 4 + 2 * 4
_SETS: Mapping[int, _Item] = {
    0: (_TEXT, _Counted(_TEXT)),  # marker set: name, markers
    3: (4, _TEXT, _PLATE, _Counted(_TEXT)),  # force plate: id, serial, geometry, channels
    4: (4, _TEXT, _TEXT, 8, _Counted(_TEXT)),  # device: id, name, serial, type, channels
    5: (_TEXT, 12 + 16),  # camera: name, pose
}
"""Type of a set of definitions that is skipped -> its content."""
_RIGID_BODY, _SKELETON, _ASSET = 1, 2, 6
"""Types of the sets that are kept."""

_NUMBER = struct.Struct("<I")
_OWNER = struct.Struct("<iI")
_BODY = struct.Struct("<ii3f")
_QUATERNION = 16
_MARKER_OFFSET_AND_LABEL = 16
_ASSET_MARKERS = _Counted((_TEXT, 4 + 12 + 4 + 2))
_PLAIN_SUFFIX = struct.Struct("<IIdQQQHI")
_SIZED_SUFFIX = struct.Struct("<IIdQQQIIHI")
"""Time code and its fraction, timestamp s, ticks of exposure, arrival and sending, since 4.1 s and fraction of an
external clock, flags, end tag."""
_TAIL = struct.Struct("<H4x")
_SHORTEST = 4 + 7 * 4 + _PLAIN_SUFFIX.size
"""Bytes of an empty frame."""


class FrameFlags(IntFlag, boundary=CONFORM):
    """Bits of a frame as Motive sets them; others are dropped, because each new value would stay in memory."""

    RECORDING = 1
    DEFINITIONS_CHANGED = 2
    EDIT = 4
    BITSTREAM_CHANGED = 8


@dataclass(frozen=True, slots=True)
class PoseGroup:
    """Poses that follow each other. number: id of the skeleton or asset, 0 for rigid bodies."""

    owner: Owner
    number: int
    count: int


@dataclass(frozen=True, slots=True, eq=False)
class FrameOfData:
    """Content of a frame. poses: records of `POSE_RECORD`, group after group. timestamp: s, by Motive. mid_exposure:
    ticks of the server's clock (0: unknown). surplus: bytes after the suffix."""

    number: int
    groups: tuple[PoseGroup, ...]
    poses: bytes
    timestamp: float
    mid_exposure: int
    surplus: int


class _Malformed(ValueError):
    """The bytes do not hold what their counts and sizes announce."""


class _Cursor:
    """Reads a payload from front to back. Methods raise _Malformed or struct.error if the bytes end too soon."""

    def __init__(self, payload: bytes) -> None:
        self.payload = payload
        self.at = 0

    def unpack(self, layout: struct.Struct) -> tuple[Any, ...]:
        values = layout.unpack_from(self.payload, self.at)
        self.at += layout.size
        return values

    def count(self) -> int:
        return int(self.unpack(_NUMBER)[0])

    def take(self, size: int) -> bytes:
        start = self.at
        self.at += size
        if self.at > len(self.payload):
            raise _Malformed
        return self.payload[start : self.at]

    def text(self) -> str:
        end = self.payload.find(b"\0", self.at)
        if end < 0:
            raise _Malformed
        return text_until_zero(self.take(end + 1 - self.at))

    def skip(self, item: _Item, times: int = 1) -> None:
        if isinstance(item, int):
            self.take(item * times)
            return
        for _ in range(times):
            if isinstance(item, _Text):
                self.text()
            elif isinstance(item, _Counted):
                self.skip(item.item, self.count())
            else:
                for part in item:
                    self.skip(part)


def read_frame(payload: bytes, version: Version) -> FrameOfData | None:
    """A frame in the layout of `version`; None if the bytes hold none. Only a frame without surplus surely has this
    layout."""
    cursor, sized = _Cursor(payload), version >= SIZED_SINCE
    groups: list[PoseGroup] = []
    poses: list[bytes] = []
    try:
        number = cursor.count()
        for content, since in _BLOCKS:
            if version < since:
                continue
            count = cursor.count()
            end = cursor.count() + cursor.at if sized else 0
            if isinstance(content, Owner):
                _read_poses(cursor, content, count, groups, poses)
            elif isinstance(content, int) or not sized:
                cursor.skip(content, count)
            if sized:
                _end(cursor, end)
        _, _, timestamp, mid_exposure, *_ = cursor.unpack(_SIZED_SUFFIX if sized else _PLAIN_SUFFIX)
    except (_Malformed, struct.error):
        return None
    return FrameOfData(
        number=number,
        groups=tuple(groups),
        poses=b"".join(poses),
        timestamp=timestamp,
        mid_exposure=mid_exposure,
        surplus=len(payload) - cursor.at,
    )


def _read_poses(cursor: _Cursor, owner: Owner, count: int, groups: list[PoseGroup], poses: list[bytes]) -> None:
    """Read a block of poses: of all rigid bodies, or of `count` skeletons or assets."""
    alone = owner is Owner.RIGID_BODIES
    for _ in range(1 if alone else count):
        number, bodies = (0, count) if alone else cursor.unpack(_OWNER)
        records = cursor.take(POSE_RECORD.itemsize * bodies)
        if bodies:
            groups.append(PoseGroup(owner, number, bodies))
            poses.append(records)
        if owner is Owner.ASSET:
            cursor.skip(_Counted(_LABELLED_MARKER))


def _end(cursor: _Cursor, end: int, *, exact: bool = False) -> None:
    if cursor.at > end or (exact and cursor.at < end):
        raise _Malformed
    cursor.at = end


def read_flags(payload: bytes) -> FrameFlags | None:
    """The flags, which precede the end tag of four bytes; None if the payload is too short for a frame."""
    if len(payload) < _SHORTEST:
        return None
    return FrameFlags(*_TAIL.unpack_from(payload, len(payload) - _TAIL.size))


@dataclass(frozen=True, slots=True)
class BodyDefinition:
    """A rigid body or a bone. parent: id of its parent in the skeleton, 0 or -1 if it has none. offset (3) m: from the
    parent, in the parent's frame, in the server's axes."""

    name: str
    number: int
    parent: int
    offset: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class GroupDefinition:
    """A skeleton or a trained asset, and its bones."""

    name: str
    number: int
    bones: tuple[BodyDefinition, ...]


@dataclass(frozen=True, slots=True)
class Definitions:
    """All that has a pose in the stream."""

    rigid_bodies: tuple[BodyDefinition, ...] = ()
    skeletons: tuple[GroupDefinition, ...] = ()
    assets: tuple[GroupDefinition, ...] = ()


def read_definitions(payload: bytes, version: Version) -> Definitions | None:
    """The definitions; None if the bytes hold none.

    The layout of `version` is tried first, then the others: a changed bitstream is not always announced in time. The
    layout that uses up every byte is right. If none does, sets of the own layout may hold unknown content, as their
    sizes say.
    """
    own = max((layout for layout in _LAYOUTS if layout <= version), default=OLDEST)
    others = [layout for layout in _LAYOUTS if layout != own]
    for layout, exact in ((own, True), *((other, True) for other in others), (own, False)):
        try:
            return _read_sets(_Cursor(payload), layout, exact=exact)
        except (_Malformed, struct.error):
            continue
    return None


def _read_sets(cursor: _Cursor, version: Version, *, exact: bool) -> Definitions:
    """All sets in the layout of a version. exact: sizes must be those of the known content."""
    sized = version >= SIZED_SINCE
    found: dict[int, list[Any]] = {_RIGID_BODY: [], _SKELETON: [], _ASSET: []}
    for _ in range(cursor.count()):
        kind = cursor.count()
        end = cursor.count() + cursor.at if sized else 0
        if kind == _RIGID_BODY:
            found[kind].append(_read_body(cursor, version))
        elif kind in found:
            found[kind].append(_read_group(cursor, version, kind))
        elif sized:
            cursor.take(end - cursor.at)
        elif kind in _SETS:
            cursor.skip(_SETS[kind])
        else:
            raise _Malformed
        if sized:
            _end(cursor, end, exact=exact)
    _end(cursor, len(cursor.payload), exact=True)
    return Definitions(*(tuple(sets) for sets in found.values()))


def _read_body(cursor: _Cursor, version: Version) -> BodyDefinition:
    name = cursor.text()
    number, parent, x, y, z = cursor.unpack(_BODY)
    if version >= _TURNED_SINCE:
        cursor.take(_QUATERNION)
    markers = cursor.count()
    cursor.take(_MARKER_OFFSET_AND_LABEL * markers)
    if version >= _MARKERS_NAMED_SINCE:
        cursor.skip(_TEXT, markers)
    return BodyDefinition(name, number, parent, (x, y, z))


def _read_group(cursor: _Cursor, version: Version, kind: int) -> GroupDefinition:
    """A skeleton (name, id, bones) or an asset (name, type, id, bones, markers)."""
    name = cursor.text()
    if kind == _ASSET:
        cursor.take(4)
    number, bones = cursor.unpack(_OWNER)
    found = tuple([_read_body(cursor, version) for _ in range(bones)])
    if kind == _ASSET:
        cursor.skip(_ASSET_MARKERS)
    return GroupDefinition(name, number, found)
