"""NatNet model definitions: names, ids and parents of what the frames carry by id.

A u32 count of data sets; each: u32 type, from 4.1 on u32 size in bytes, then the set. Rigid bodies name their markers
from 4.0 on and have a rotation from 4.2 on. Marker sets, force plates, devices and cameras are passed over.
"""

import struct
from dataclasses import dataclass

from retarget.sources.natnet_frame import SIZED_SINCE
from retarget.sources.natnet_wire import Version, text_until_zero

__all__ = ["BodyDefinition", "Definitions", "GroupDefinition", "read_definitions"]

_MARKERS_NAMED_SINCE = Version(4, 0)
_TURNED_SINCE = Version(4, 2)
_LAYOUTS = (Version(3, 0), Version(4, 0), Version(4, 1), Version(4, 2))
"""The first version of each layout."""

_BODY = struct.Struct("<ii3f")
_QUATERNION = 16
_MARKER_OFFSET_AND_LABEL = 16
_NUMBER = struct.Struct("<I")
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


class _Malformed(ValueError):
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
            raise _Malformed

    def raw_text(self) -> bytes:
        """Bytes up to a NUL, which is passed."""
        start = self.at
        end = self.payload.find(b"\0", start)
        if end < 0:
            raise _Malformed
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
            raise _Malformed


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
    except (_Malformed, struct.error):
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
                raise _Malformed
            cursor.at = end
    if cursor.at != len(cursor.payload):
        raise _Malformed
    return Definitions(tuple(bodies), tuple(skeletons), tuple(assets))
