"""Printed frames of the e-Manual, as bytes and as what they mean."""

from collections.abc import Callable
from typing import NamedTuple

import more_frames as more
from hardware.clock import VirtualClock
from hardware.dynamixel.codec import BROADCAST, Status, WireFrame
from hardware.dynamixel.codec import protocol1 as p1
from hardware.dynamixel.codec import protocol2 as p2
from hardware.errors import BusError


class Vector(NamedTuple):
    """A frame: its printed bytes, our bytes, what a parser returns."""

    printed: bytes
    built: bytes
    frame: WireFrame


def two(printed: str, built: bytes | None = None) -> Vector:
    """Of protocol 2.0, in hexadecimal: header (4), id, length (2), instruction, parameters, CRC (2); unstuffed."""
    raw = bytes.fromhex(printed)
    frame = WireFrame(raw[4], raw[7], raw[8:-2])
    return Vector(raw, p2.frame(*frame) if built is None else built, frame)


def one(printed: str, built: bytes | None = None) -> Vector:
    """Of protocol 1.0: header (2), id, length, instruction, parameters, checksum."""
    raw = bytes.fromhex(printed)
    frame = WireFrame(raw[2], raw[4], raw[5:-1])
    return Vector(raw, p1.frame(*frame) if built is None else built, frame)


FAST_SYNC = (Status(3, 0, b"\xa6\0\0\0"), Status(7, 0, b"\x1f\x08\0\0"), Status(4, 0, b"\xff\x03\0\0"))
"""Answers of the e-Manual's fast sync read."""
FAST_SYNC_REPLY = bytes.fromhex("FFFFFD00FE19005500 03A6000000 8408 00 071F080000 16CA 00 04FF030000 D19E")

FAST_BULK = (Status(3, 0, b"\xa6\0\0\0"), Status(7, 0, b"\xa5\x01"), Status(4, 0, b"\x1f"))
"""Answers of the e-Manual's fast bulk read."""
FAST_BULK_REPLY = bytes.fromhex("FFFFFD00FE14005500 03A6000000 67A4 00 07A501 2474 00 041F D9C1")

TWO = [
    two("FFFFFD000103000119 4E", p2.ping(1)),
    two("FFFFFD0001070055000604 26655D", p2.status(1, 0, b"\x06\x04\x26")),
    two("FFFFFD00FE0300013142", p2.ping(BROADCAST)),
    two("FFFFFD00010700028400 04001D15", more.read(1, 132, 4)),
    two("FFFFFD0001080055 00A6000000 8CC0", p2.status(1, 0, b"\xa6\0\0\0")),
    two("FFFFFD0001090003 7400 00020000 CA89", p2.write(1, 116, b"\0\2\0\0")),
    two("FFFFFD0001040055 00 A10C", p2.status(1)),
    two("FFFFFD0001090004 6800 C8000000 AE8E"),  # reg write
    two("FFFFFD0001030005 02CE"),  # action
    two("FFFFFD0001040006 01 A1E6"),  # factory reset, all but the id
    two("FFFFFD0001030008 2F4E", more.reboot(1)),
    two("FFFFFD0001080010 0144584C22 B1DC"),  # clear the turns
    two("FFFFFD0001080020 014354524C 16F5"),  # back up the control table
    two("FFFFFD0001080020 024354524C 9EF5"),  # restore it; the CRC is right here, not in print
    two("FFFFFD00FE090082 8400 0400 0102 CEFA", p2.sync_read(132, 4, (1, 2))),
    two(
        "FFFFFD00FE110083 7400 0400 0196000000 02AA000000 8287",
        p2.sync_write(116, 4, ((1, b"\x96\0\0\0"), (2, b"\xaa\0\0\0"))),
    ),
    two("FFFFFD00FE0D0092 0190000200 0292000100 1A05", more.bulk_read(((1, 144, 2), (2, 146, 1)))),
    two("FFFFFD00FE100093 0120000200A000 021F00010050 B768"),  # bulk write
    two("FFFFFD00FE0A008A 8400 0400 030704 20F2", p2.sync_read(132, 4, (3, 7, 4), fast=True)),
    two(  # the CRC is right here, not in print
        "FFFFFD00FE12009A 0384000400 077C000200 0492000100 DA2D",
        more.bulk_read(((3, 132, 4), (7, 124, 2), (4, 146, 1)), fast=True),
    ),
    two(FAST_BULK_REPLY.hex(), more.fast_status(FAST_BULK)),
    two(FAST_SYNC_REPLY.hex(), more.fast_status(FAST_SYNC)),
]
"""Protocol 2.0."""

ONE = [
    one("FFFF010201FB", p1.ping(1)),
    one("FFFF010200FC", p1.status(1)),
    one("FFFF010402 2B01 CC", p1.read(1, 43, 1)),
    one("FFFF010300 20 DB", p1.status(1, 0, b"\x20")),
    one("FFFFFE0403 0301 F6", p1.write(BROADCAST, 3, b"\x01")),
    one("FFFF010504 1EF401 E2"),  # reg write
    one("FFFFFE0205FA"),  # action
    one(
        "FFFFFE0E83 1E04 0010005001 0120026003 67",
        p1.sync_write(30, 4, ((0, b"\x10\0\x50\x01"), (1, b"\x20\x02\x60\x03"))),
    ),
    one("FFFFFE0992 00 02011E 020224 1D", p1.bulk_read(((1, 30, 2), (2, 36, 2)))),
]
"""Protocol 1.0."""


# A port in memory for dynamixel-sdk's packet handlers.


class SdkPort:
    """As much of a port as dynamixel-sdk needs to send a frame, or to take one in."""

    is_using = False

    def __init__(self, received: bytes = b"") -> None:
        self.received, self.sent = received, b""

    def clearPort(self) -> None:
        pass

    def writePort(self, data: list[int]) -> int:
        self.sent = bytes(data)
        return len(data)

    def readPort(self, size: int) -> list[int]:
        taken, self.received = self.received[:size], self.received[size:]
        return list(taken)

    def isPacketTimeout(self) -> bool:
        return not self.received


# A port whose answers a test writes down: bytes in, bytes out, virtual time.

Replies = list[tuple[float, bytes]]
"""What comes back, and when, s after the request."""


class ScriptedPort:
    """A `BytePort`; `answer` is called with every request and returns what it brings."""

    def __init__(self, answer: Callable[[bytes], Replies], *, baud: int = 1_000_000, latency: float = 0.001) -> None:
        self.clock = VirtualClock()
        self.sent: list[bytes] = []
        self.waits = 0
        self.name, self.baud, self.latency = "scripted", baud, latency
        self.broken = False
        self._answer = answer
        self._coming: Replies = []

    def open(self, baud: int) -> None:
        self.baud = baud

    def set_baud(self, baud: int) -> None:
        self.baud = baud

    def write(self, data: bytes) -> None:
        self._check()
        self.sent.append(data)
        self._coming += [(self.now() + delay, reply) for delay, reply in self._answer(data)]
        self._coming.sort(key=lambda item: item[0])

    def read(self) -> bytes:
        self._check()
        data = b"".join(reply for due, reply in self._coming if due <= self.now())
        self._coming = [item for item in self._coming if item[0] > self.now()]
        return data

    def wait(self, deadline: float) -> bool:
        self._check()
        self.waits += 1
        due = self._coming[0][0] if self._coming else deadline
        self.clock.sleep_until(min(due, deadline))
        return bool(self._coming) and due <= self.now()

    def drop(self) -> None:
        self.read()

    def now(self) -> float:
        return self.clock.now()

    def sleep_until(self, deadline: float) -> None:
        self.clock.sleep_until(deadline)

    def close(self) -> None:
        pass

    def feed(self, data: bytes, after: float = 0.0) -> None:
        """Bytes that arrive without a request."""
        self._coming.append((self.now() + after, data))
        self._coming.sort(key=lambda item: item[0])

    def _check(self) -> None:
        if self.broken:
            raise BusError("scripted: gone.")


def always(*replies: bytes, after: float = 0.0005) -> Callable[[bytes], Replies]:
    """The same answer to everything."""
    return lambda request: [(after, reply) for reply in replies]


def in_turn(*replies: bytes, after: float = 0.0005) -> Callable[[bytes], Replies]:
    """One answer to each request, silence where it is empty and after the last."""
    left = list(replies)
    return lambda request: [(after, left.pop(0))] if left else []
