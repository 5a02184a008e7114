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

from retarget.sources.natnet_wire import Version

__all__ = [
    "BODY",
    "MARKER",
    "SIZED_SINCE",
    "FrameFlags",
    "FrameOfData",
    "Owner",
    "PoseGroup",
    "read_flags",
    "read_frame",
]

SIZED_SINCE = Version(4, 1)
"""The bitstream in which blocks began to tell their sizes."""

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
"""Bytes of a frame of nothing."""


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
    """What a frame tells. poses: records of `BODY`, group after group, as they came. markers: records of `MARKER`.

    timestamp: s, as Motive counts them. mid_exposure, received, transmitted: ticks of the server's clock (0: not told).
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
