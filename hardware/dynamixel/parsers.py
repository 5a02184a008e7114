"""Incremental parsers: bytes in as they arrive, sound frames out; garbage is skipped and counted, memory is bounded."""

from collections.abc import Callable
from struct import Struct
from typing import NamedTuple

from fastcrc.crc16 import umts

from hardware.dynamixel import protocol1, protocol2
from hardware.dynamixel.packets import BROADCAST, STATUS, Frame


class Found(NamedTuple):
    """What a scan found.

    used: bytes of all `frames`. at: where bytes begin that may still become a frame (the end: nowhere). clear: bytes
    from there on in which no second header begins: they need no second look.
    """

    frames: list[Frame]
    used: int
    at: int
    clear: int


Scan = Callable[[bytes, int], Found]
"""From bytes, the first so many of which hold no header but the one that they begin with."""


class Parser:
    """Frames of one protocol. Between two calls it holds less than one frame's bytes. The frames depend on the bytes
    alone, never on the pieces in which they came."""

    def __init__(self, scan: Scan) -> None:
        self._scan = scan
        self._pending = b""
        self._clear = 0
        self.skipped = 0
        """Bytes so far that belonged to no sound frame."""

    @property
    def pending(self) -> bytes:
        """What may still become a frame."""
        return self._pending

    def reset(self) -> None:
        """Forget what is pending."""
        self.skipped += len(self._pending)
        self._pending, self._clear = b"", 0

    def feed(self, data: bytes | bytearray) -> list[Frame]:
        """All frames that `data` completes, in order."""
        buffer = self._pending + data
        frames, used, at, self._clear = self._scan(buffer, self._clear)
        self.skipped += at - used
        self._pending = buffer[at:]
        return frames

    def flush(self) -> list[Frame]:
        """The line has fallen silent: no frame that has begun will be completed. Frames that lie inside one (its length
        was damaged, say); nothing is pending afterwards."""
        frames: list[Frame] = []
        while self._pending:
            behind = self._pending[1:]
            self.skipped += 1
            self._pending, self._clear = b"", 0
            frames += self.feed(behind)
        return frames


def parser2() -> Parser:
    """A parser of protocol 2.0."""
    return Parser(_scan2)


def parser1() -> Parser:
    """A parser of protocol 1.0. Its checksum is one byte: of damaged frames one of 256 passes."""
    return Parser(_scan1)


_ID_AND_LENGTH_2 = Struct("<BH").unpack_from
_CRC = Struct("<H").unpack_from


def _scan2(buffer: bytes, clear: int) -> Found:
    """Frames of protocol 2.0.

    Stuffing keeps headers out of a body, so one inside ends a broken frame at once: a damaged length costs no more than
    its own frame. A fast status is not stuffed: only its length tells where it ends.
    """
    header, overhead = protocol2.HEADER, protocol2.OVERHEAD
    frames: list[Frame] = []
    used, begin, size = 0, 0, len(buffer)
    at, stuffed = buffer.find(header), None
    while 0 <= at <= size - overhead:
        begin = at + len(header)
        device, length = _ID_AND_LENGTH_2(buffer, begin)
        behind = buffer.find(header, begin if at else max(begin, clear))
        if device > BROADCAST or device == 0xFD or not 3 <= length <= protocol2.MAX_LENGTH:
            at = behind
            continue
        body, close = at + overhead, at + overhead + length - 2
        fast = device == BROADCAST and body < size and buffer[body] == STATUS
        if 0 <= behind <= close - len(header) and not fast:
            at = behind
        elif size < close + 2:
            return Found(frames, used, at, (behind if behind >= 0 else size - len(header) + 1) - at)
        elif umts(buffer[at:close], 0) != _CRC(buffer, close)[0]:
            at = behind
        else:
            if stuffed is None:
                stuffed = protocol2.STUFFED in buffer  # once, not for every frame: it seldom is
            content = protocol2.unstuff(buffer[body:close]) if stuffed and not fast else buffer[body:close]
            frames.append(Frame(device, content[0], content[1:]))
            begin = close + 2
            used += begin - at
            at = behind if behind < 0 or behind >= begin else buffer.find(header, begin)
    return Found(frames, used, at if at >= 0 else _tail(buffer, begin, header), 0)


def _scan1(buffer: bytes, _clear: int) -> Found:
    """Frames of protocol 1.0. Any bytes may stand in a body, so only its length tells where a frame ends."""
    header, overhead = protocol1.HEADER, protocol1.OVERHEAD
    frames: list[Frame] = []
    used, begin, size = 0, 0, len(buffer)
    at = buffer.find(header)
    while 0 <= at <= size - overhead:
        begin = at + 1
        device, length = buffer[at + 2], buffer[at + 3]
        close = at + overhead + length - 1
        if device > BROADCAST or length < 2:
            at = buffer.find(header, begin)
        elif size <= close:
            break
        elif ~sum(buffer[at + 2 : close]) & 0xFF != buffer[close]:
            at = buffer.find(header, begin)
        else:
            frames.append(Frame(device, buffer[at + 4], buffer[at + 5 : close]))
            begin = close + 1
            used += begin - at
            at = buffer.find(header, begin)
    return Found(frames, used, at if at >= 0 else _tail(buffer, begin, header), 0)


def _tail(buffer: bytes, begin: int, header: bytes) -> int:
    """Where the longest beginning of a header starts that ends `buffer`; not before `begin`."""
    size = len(buffer)
    for count in range(len(header) - 1, 0, -1):
        if size - begin >= count and buffer.endswith(header[:count]):
            return size - count
    return size
