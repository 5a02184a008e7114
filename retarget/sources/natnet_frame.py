"""A NatNet frame of data: where the poses lie in it, and its suffix of stamps and flags.

Blocks in this order, each led by a u32 count: marker sets, other markers, rigid bodies, skeletons, trained assets (from
4.1), labelled markers, force plates, devices. From 4.1 on a u32 size in bytes follows each count, and what a block
holds beyond what is known here is skipped by it. Only poses and labelled markers are kept.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from retarget.sources.natnet_wire import Version, text_until_zero

SIZED_SINCE = Version(4, 1)
"""The first bitstream whose blocks carry their sizes."""

BODY = np.dtype([("id", "<i4"), ("pose", "<f4", 7), ("error", "<f4"), ("flags", "<i2")])
"""One pose on the wire, 38 bytes: position m and quaternion xyzw, mean marker error m; bit 0 of flags: tracked."""

MARKER = np.dtype([("id", "<i4"), ("position", "<f4", 3), ("size", "<f4"), ("flags", "<i2"), ("residual", "<f4")])
"""One labelled marker on the wire, 26 bytes: m; bit 0 of flags: hidden from the cameras, its place is computed."""

_POSITION = 12
_NUMBER = struct.Struct("<I")
_PAIR = struct.Struct("<II")
_OWNER = struct.Struct("<iI")
_PLAIN_SUFFIX = struct.Struct("<IIdQQQHI")
_SIZED_SUFFIX = struct.Struct("<IIdQQQIIHI")
_TAIL = struct.Struct("<H4x")
_SHORTEST = 4 + 7 * 4 + _PLAIN_SUFFIX.size
"""Bytes of an empty frame."""


class Owner(Enum):
    """What a group of poses belongs to."""

    RIGID_BODIES = "rigid"
    SKELETON = "bone"
    ASSET = "asset"


@dataclass(frozen=True, slots=True)
class PoseGroup:
    """Poses that follow each other. number: id of the skeleton or asset, 0 for rigid bodies."""

    owner: Owner
    number: int
    count: int


@dataclass(frozen=True, slots=True)
class FrameFlags:
    """Bits of a frame as Motive sets them."""

    bits: int

    @property
    def recording(self) -> bool:
        """Motive is recording."""
        return bool(self.bits & 1)

    @property
    def definitions_changed(self) -> bool:
        """Names or ids are no longer what the last model definitions said."""
        return bool(self.bits & 2)

    @property
    def edit(self) -> bool:
        """Motive is in its edit mode, where it plays recordings back."""
        return bool(self.bits & 4)

    @property
    def bitstream_changed(self) -> bool:
        """From now on frames come in another version."""
        return bool(self.bits & 8)


@dataclass(frozen=True, slots=True, eq=False)
class FrameOfData:
    """Content of a frame. poses: records of `BODY`, group after group, as they came. markers: records of `MARKER`.

    timestamp: s, as Motive counts them. mid_exposure, received, transmitted: ticks of the server's clock (0: unknown).
    precision: seconds and fraction of an outer clock (2^-32 s), from 4.1. surplus: bytes behind the suffix.
    """

    number: int
    groups: tuple[PoseGroup, ...]
    poses: bytes
    markers: bytes
    timestamp: float
    mid_exposure: int
    received: int
    transmitted: int
    precision: tuple[int, int] | None
    flags: FrameFlags
    surplus: int


class _Malformed(ValueError):
    """The bytes end before what their counts announce."""


class _Walk:
    """Reads one payload front to back; `groups` and `slices` gather its poses."""

    __slots__ = ("at", "groups", "markers", "payload", "slices")

    def __init__(self, payload: bytes) -> None:
        self.payload = payload
        self.at = 4
        self.groups: list[PoseGroup] = []
        self.slices: list[bytes] = []
        self.markers = b""

    def count(self) -> int:
        """A u32."""
        (value,) = _NUMBER.unpack_from(self.payload, self.at)
        self.at += 4
        return int(value)

    def skip(self, size: int) -> None:
        """Leaves bytes out."""
        self.at += size
        if self.at > len(self.payload):
            raise _Malformed

    def bodies(self, owner: Owner, number: int, count: int) -> None:
        """Poses of one owner."""
        start = self.at
        self.skip(BODY.itemsize * count)
        if count:
            self.groups.append(PoseGroup(owner, number, count))
            self.slices.append(self.payload[start : self.at])

    def marker_sets(self, count: int) -> None:
        """Each: name, NUL, count, positions."""
        for _ in range(count):
            end = self.payload.find(b"\0", self.at)
            if end < 0:
                raise _Malformed
            self.at = end + 1
            self.skip(_POSITION * self.count())

    def other_markers(self, count: int) -> None:
        """Positions."""
        self.skip(_POSITION * count)

    def rigid_bodies(self, count: int) -> None:
        """Poses."""
        self.bodies(Owner.RIGID_BODIES, 0, count)

    def skeletons(self, count: int) -> None:
        """Each: id, count, poses."""
        for _ in range(count):
            number, bones = _OWNER.unpack_from(self.payload, self.at)
            self.at += 8
            self.bodies(Owner.SKELETON, number, bones)

    def assets(self, count: int) -> None:
        """Each: id, count, poses, count, labelled markers."""
        for _ in range(count):
            number, bodies = _OWNER.unpack_from(self.payload, self.at)
            self.at += 8
            self.bodies(Owner.ASSET, number, bodies)
            self.skip(MARKER.itemsize * self.count())

    def labelled_markers(self, count: int) -> None:
        """Records of `MARKER`."""
        start = self.at
        self.skip(MARKER.itemsize * count)
        self.markers = self.payload[start : self.at]

    def channels(self, count: int) -> None:
        """Force plates and devices, each: id, count of channels; each of them: count, floats."""
        for _ in range(count):
            _, channels = _PAIR.unpack_from(self.payload, self.at)
            self.at += 8
            for _ in range(channels):
                self.skip(4 * self.count())


_Block = Callable[[_Walk, int], None]
_PLAIN: tuple[_Block, ...] = (
    _Walk.marker_sets,
    _Walk.other_markers,
    _Walk.rigid_bodies,
    _Walk.skeletons,
    _Walk.labelled_markers,
    _Walk.channels,
    _Walk.channels,
)
_SIZED: tuple[_Block | None, ...] = (
    *(None, None),
    *(_Walk.rigid_bodies, _Walk.skeletons, _Walk.assets, _Walk.labelled_markers),
    *(None, None),
)
"""None: skipped by its size alone."""


def read_frame(payload: bytes, version: Version) -> FrameOfData | None:
    """A frame as `version` lays it out; None where the bytes do not hold one.

    A frame of another layout mostly gives None or a surplus: only one without surplus surely fits.
    """
    walk = _Walk(payload)
    try:
        (number,) = _NUMBER.unpack_from(payload)
        if version >= SIZED_SINCE:
            for block in _SIZED:
                _read_sized(walk, block)
            *stamps, seconds, fraction, flags, _ = _SIZED_SUFFIX.unpack_from(payload, walk.at)
            walk.at += _SIZED_SUFFIX.size
            precision = (seconds, fraction)
        else:
            for walker in _PLAIN:
                walker(walk, walk.count())
            *stamps, flags, _ = _PLAIN_SUFFIX.unpack_from(payload, walk.at)
            walk.at += _PLAIN_SUFFIX.size
            precision = None
    except (_Malformed, struct.error):
        return None
    _, _, timestamp, mid_exposure, received, transmitted = stamps
    return FrameOfData(
        number=number,
        groups=tuple(walk.groups),
        poses=b"".join(walk.slices),
        markers=walk.markers,
        timestamp=timestamp,
        mid_exposure=mid_exposure,
        received=received,
        transmitted=transmitted,
        precision=precision,
        flags=FrameFlags(flags),
        surplus=len(payload) - walk.at,
    )


def _read_sized(walk: _Walk, block: _Block | None) -> None:
    count, size = _PAIR.unpack_from(walk.payload, walk.at)
    start = walk.at + 8
    end = start + size
    if block is not None:
        walk.at = start
        block(walk, count)
        if walk.at > end:
            raise _Malformed
    walk.at = end


def read_flags(payload: bytes) -> FrameFlags | None:
    """The flags alone, which stand before the end tag of four bytes; None where the payload is no frame by its size."""
    if len(payload) < _SHORTEST:
        return None
    return FrameFlags(*_TAIL.unpack_from(payload, len(payload) - _TAIL.size))


# NatNet model definitions: names, ids and parents of what the frames carry by id.
#
# A u32 count of data sets; each: u32 type, from 4.1 on u32 size in bytes, then the set. Rigid bodies name their markers
# from 4.0 on and have a rotation from 4.2 on. Marker sets, force plates, devices and cameras are passed over.

_MARKERS_NAMED_SINCE = Version(4, 0)
_TURNED_SINCE = Version(4, 2)
_LAYOUTS = (Version(3, 0), Version(4, 0), Version(4, 1), Version(4, 2))
"""The first version of each layout."""

_BODY = struct.Struct("<ii3f")
_QUATERNION = 16
_MARKER_OFFSET_AND_LABEL = 16
_MARKER = 4 + 12 + 4 + 2
_PLATE = 2 * 4 + 12 + 144 * 4 + 12 * 4 + 2 * 4
_CAMERA = 12 + 16


@dataclass(frozen=True, slots=True)
class BodyDefinition:
    """A rigid body or a bone. parent: id of its parent in the same skeleton, 0 or -1 where it has none.

    offset (3) m: from the parent, in the parent's frame, in the server's axes.
    """

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
    """All that is streamed and has a pose."""

    rigid_bodies: tuple[BodyDefinition, ...] = ()
    skeletons: tuple[GroupDefinition, ...] = ()
    assets: tuple[GroupDefinition, ...] = ()


class _MalformedDefinitions(ValueError):
    """The bytes do not hold what they announce."""


class _Cursor:
    """Reads one payload front to back in the layout of one version."""

    def __init__(self, payload: bytes, version: Version) -> None:
        self.payload = payload
        self.at = 0
        self.sized = version >= SIZED_SINCE
        self.markers_named = version >= _MARKERS_NAMED_SINCE
        self.turned = version >= _TURNED_SINCE

    def number(self) -> int:
        """A u32."""
        (value,) = _NUMBER.unpack_from(self.payload, self.at)
        self.at += 4
        return int(value)

    def skip(self, size: int) -> None:
        """Leaves bytes out."""
        self.at += size
        if self.at > len(self.payload):
            raise _MalformedDefinitions

    def raw_text(self) -> bytes:
        """Bytes up to a NUL, which is passed."""
        start = self.at
        end = self.payload.find(b"\0", start)
        if end < 0:
            raise _MalformedDefinitions
        self.at = end + 1
        return self.payload[start:end]

    def texts(self, count: int) -> None:
        """Passes over texts."""
        for _ in range(count):
            self.raw_text()

    def body(self) -> BodyDefinition:
        """A rigid body or bone."""
        name = text_until_zero(self.raw_text())
        number, parent, x, y, z = _BODY.unpack_from(self.payload, self.at)
        self.at += _BODY.size
        if self.turned:
            self.skip(_QUATERNION)
        markers = self.number()
        self.skip(_MARKER_OFFSET_AND_LABEL * markers)
        if self.markers_named:
            self.texts(markers)
        return BodyDefinition(name, number, parent, (x, y, z))

    def skeleton(self) -> GroupDefinition:
        """Name, id, bones."""
        name = text_until_zero(self.raw_text())
        number = _signed(self.number())
        return GroupDefinition(name, number, self.bones())

    def asset(self) -> GroupDefinition:
        """Name, type, id, bones, markers."""
        name = text_until_zero(self.raw_text())
        self.skip(4)
        number = _signed(self.number())
        bones = self.bones()
        for _ in range(self.number()):
            self.raw_text()
            self.skip(_MARKER)
        return GroupDefinition(name, number, bones)

    def bones(self) -> tuple[BodyDefinition, ...]:
        """A count, then as many."""
        return tuple([self.body() for _ in range(self.number())])

    def pass_over(self, kind: int) -> None:
        """A marker set (0), force plate (3), device (4) or camera (5)."""
        if kind == 0:
            self.raw_text()
            self.texts(self.number())
        elif kind == 3:
            self.skip(4)
            self.raw_text()
            self.skip(_PLATE)
            self.texts(self.number())
        elif kind == 4:
            self.skip(4)
            self.texts(2)
            self.skip(8)
            self.texts(self.number())
        elif kind == 5:
            self.raw_text()
            self.skip(_CAMERA)
        else:
            raise _MalformedDefinitions


def _signed(value: int) -> int:
    return value - 2**32 if value >= 2**31 else value


def read_definitions(payload: bytes, version: Version) -> Definitions | None:
    """The definitions; None where the bytes hold none.

    version: whose layout is tried first. A pinned or changed bitstream is not always announced before its definitions
    arrive, so the other layouts are tried after it; the one that uses up every byte is right. If none does, sets of the
    own layout may hold more than is known here, as their sizes say.
    """
    own = max((layout for layout in _LAYOUTS if layout <= version), default=_LAYOUTS[0])
    for layout in (own, *(layout for layout in _LAYOUTS if layout != own)):
        found = _read(payload, layout, exact=True)
        if found is not None:
            return found
    return _read(payload, own, exact=False)


def _read(payload: bytes, layout: Version, *, exact: bool) -> Definitions | None:
    try:
        return _read_sets(_Cursor(payload, layout), exact=exact)
    except (_MalformedDefinitions, struct.error):
        return None


def _read_sets(cursor: _Cursor, *, exact: bool) -> Definitions:
    bodies: list[BodyDefinition] = []
    skeletons: list[GroupDefinition] = []
    assets: list[GroupDefinition] = []
    for _ in range(cursor.number()):
        kind = cursor.number()
        size = cursor.number() if cursor.sized else 0
        end = cursor.at + size
        if kind == 1:
            bodies.append(cursor.body())
        elif kind == 2:
            skeletons.append(cursor.skeleton())
        elif kind == 6:
            assets.append(cursor.asset())
        elif cursor.sized:
            cursor.skip(size)
        else:
            cursor.pass_over(kind)
        if cursor.sized:
            if cursor.at > end or (exact and cursor.at != end):
                raise _MalformedDefinitions
            cursor.at = end
    if cursor.at != len(cursor.payload):
        raise _MalformedDefinitions
    return Definitions(tuple(bodies), tuple(skeletons), tuple(assets))
