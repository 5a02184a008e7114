"""NatNet packets made from the documented layout alone: shares no code and no table with the reader under test."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from struct import pack

from retarget.sources.streams.natnet_wire import Version

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
