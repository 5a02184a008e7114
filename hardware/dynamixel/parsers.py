"""Incremental parsers: bytes in as they arrive, sound frames out; garbage is skipped and counted, memory is bounded."""

from collections.abc import Callable

from hardware.dynamixel import protocol1, protocol2
from hardware.dynamixel.packets import BROADCAST, STATUS, Frame

Take = Callable[[bytearray], tuple[Frame | None, int]]
"""From bytes that begin with a header: the frame and its bytes; or None and how many bytes to skip, 0 while more must
come."""


class Parser:
    """Frames of one protocol. Never holds more than one frame's bytes beyond what is fed at once."""

    def __init__(self, header: bytes, overhead: int, take: Take) -> None:
        self._header, self._overhead, self._take = header, overhead, take
        self._buffer = bytearray()
        self.skipped = 0
        """Bytes so far that belonged to no sound frame."""

    @property
    def pending(self) -> bytes:
        """What may still become a frame."""
        return bytes(self._buffer)

    def reset(self) -> None:
        """Forget what is pending."""
        self._skip(len(self._buffer))

    def feed(self, data: bytes) -> list[Frame]:
        """All frames that `data` completes, in order."""
        self._buffer += data
        frames: list[Frame] = []
        while self._align():
            frame, used = self._take(self._buffer)
            if frame is not None:
                frames.append(frame)
                del self._buffer[:used]
            elif used:
                self._skip(used)
            else:
                break
        return frames

    def _align(self) -> bool:
        """Skip to the next header; whether there is one, with all that tells the frame's length."""
        at = self._buffer.find(self._header)
        if at < 0:
            kept = next(
                size for size in range(len(self._header) - 1, -1, -1) if self._buffer.endswith(self._header[:size])
            )
            at = len(self._buffer) - kept
        self._skip(at)
        return len(self._buffer) >= self._overhead

    def _skip(self, count: int) -> None:
        self.skipped += count
        del self._buffer[:count]


def parser2() -> Parser:
    """A parser of protocol 2.0."""
    return Parser(protocol2.HEADER, protocol2.OVERHEAD, _take2)


def parser1() -> Parser:
    """A parser of protocol 1.0. Its checksum is one byte: of frames in pure noise, one of 256 passes."""
    return Parser(protocol1.HEADER, protocol1.OVERHEAD, _take1)


def _take2(buffer: bytearray) -> tuple[Frame | None, int]:
    """The frame at the start of `buffer` and its bytes; or None and how many bytes to skip, 0 while more must come.

    Stuffing keeps headers out of a body, so one inside (but of a fast status, which is not stuffed) ends a broken
    frame at once: a damaged length costs no more than its own frame.
    """
    device, length = buffer[4], buffer[5] | buffer[6] << 8
    if device > BROADCAST or device == 0xFD or not 3 <= length <= protocol2.MAX_LENGTH:
        return None, len(protocol2.HEADER) - 1
    end = protocol2.OVERHEAD + length
    fast = device == BROADCAST and len(buffer) > protocol2.OVERHEAD and buffer[7] == STATUS
    if not fast:
        inside = buffer.find(protocol2.HEADER, protocol2.OVERHEAD, end - 2)
        if inside >= 0:
            return None, inside
    if len(buffer) < end:
        return None, 0
    if protocol2.crc(bytes(buffer[: end - 2])) != buffer[end - 2] | buffer[end - 1] << 8:
        return None, len(protocol2.HEADER) - 1
    body = bytes(buffer[7 : end - 2])
    if not fast:
        body = protocol2.unstuff(body)
    return Frame(device, body[0], body[1:]), end


def _take1(buffer: bytearray) -> tuple[Frame | None, int]:
    """As `_take2`, for protocol 1.0."""
    device, length = buffer[2], buffer[3]
    if device == 0xFF or not 2 <= length <= protocol1.MAX_PARAMS + 2:
        return None, 1
    end = protocol1.OVERHEAD + length
    if len(buffer) < end:
        return None, 0
    if protocol1.checksum(bytes(buffer[2 : end - 1])) != buffer[end - 1]:
        return None, 1
    return Frame(device, buffer[4], bytes(buffer[5 : end - 1])), end
