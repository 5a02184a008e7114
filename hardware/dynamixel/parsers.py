"""Incremental parsers: bytes in, valid frames out; garbage is skipped and counted, memory is bounded.

Also quick checks of a complete reply to a group read of protocol 2.0.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from struct import Struct
from typing import NamedTuple

from fastcrc.crc16 import umts

from hardware.dynamixel import protocol1, protocol2
from hardware.dynamixel.packets import ALERT, BROADCAST, STATUS, Frame, Status
from hardware.dynamixel.protocol2 import BEFORE_PARTS, PART_OVERHEAD, fast_length, fast_start


@dataclass(frozen=True, slots=True)
class Answers:
    """Answers of k servos: ids, in the order in which they came; error bytes (k); data, one after the other (k *
    size)."""

    ids: tuple[int, ...] = ()
    errors: bytes = b""
    data: bytes = b""

    def __len__(self) -> int:
        """Number of servos."""
        return len(self.ids)

    @property
    def statuses(self) -> list[Status]:
        """One by one."""
        size = len(self.data) // len(self.ids) if self.ids else 0
        return [
            Status(device, self.errors[k], self.data[k * size : (k + 1) * size]) for k, device in enumerate(self.ids)
        ]


def side_by_side(statuses: Sequence[Status]) -> Answers:
    """Answers of equal size."""
    return Answers(
        tuple([status.id for status in statuses]),
        bytes([status.error for status in statuses]),
        b"".join([status.data for status in statuses]),
    )


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
        """Bytes so far that belonged to no valid frame."""

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
    its own frame. A fast status is not stuffed: only its length shows where it ends.
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
    """Frames of protocol 1.0. Any bytes may stand in a body, so only its length shows where a frame ends."""
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


# The reply to a group read of protocol 2.0 where it is complete and valid, as in nearly every cycle: checked at once.

LAYOUTS = 512
"""Different requests that are remembered."""
_BEFORE_ERROR = 8
"""Bytes of a status frame before its error byte: header, id, LEN, instruction."""

Split = Callable[[bytes], tuple[bytes, ...]]
"""From a reply to pieces of it."""


class _Layout(NamedTuple):
    """length: of the whole reply; part: bytes from one servo to the next; starts: how its frames begin.

    heads: from a reply to the beginnings of its frames. summed: to the bytes that each CRC is of, or, where it goes on
    from the one before, to those between them. crcs: to its CRCs. values: to the data of each servo.
    """

    length: int
    part: int
    starts: tuple[bytes, ...]
    ids: bytes
    well: bytes
    heads: Split
    summed: Split
    crcs: Callable[[bytes], tuple[int, ...]]
    values: Split


def whole_reply(reply: bytes, ids: tuple[int, ...], size: int) -> Answers | None:
    """Answers of all `ids` to a Fast Sync Read of `size` bytes of each; None for a reply that is not complete and
    valid.

    Each part's CRC is of everything before it, earlier CRCs included (e-Manual, Fast Sync Read).
    """
    layout = _one_frame(ids, size)
    if len(reply) != layout.length or layout.heads(reply) != layout.starts:
        return None
    if reply[BEFORE_PARTS + 1 :: layout.part] != layout.ids:
        return None
    total, totals = 0, []
    for piece in layout.summed(reply):
        total = umts(piece, total)
        totals.append(total)
    if tuple(totals) != layout.crcs(reply):
        return None
    return _answers(reply, ids, layout, reply[BEFORE_PARTS :: layout.part])


def whole_frames(reply: bytes, ids: tuple[int, ...], size: int) -> Answers | None:
    """Answers of all `ids` to a Sync Read of `size` bytes of each, a frame each; None for a reply that is not complete
    and valid, in this order, or that has stuffing in it."""
    layout = _frames(ids, size)
    if len(reply) != layout.length or reply.count(protocol2.PATTERN) != len(ids):
        return None
    if layout.heads(reply) != layout.starts:
        return None
    if tuple([umts(frame, 0) for frame in layout.summed(reply)]) != layout.crcs(reply):
        return None
    return _answers(reply, ids, layout, reply[_BEFORE_ERROR :: layout.part])


def _answers(reply: bytes, ids: tuple[int, ...], layout: _Layout, errors: bytes) -> Answers | None:
    if errors != layout.well and any(error & ~ALERT for error in errors):  # a refusal: its data mean nothing
        return None
    return Answers(ids, errors, b"".join(layout.values(reply)))


@lru_cache(LAYOUTS)
def _one_frame(ids: tuple[int, ...], size: int) -> _Layout:
    body, more, length = size + 2, len(ids) - 1, fast_length((size,) * len(ids))
    return _Layout(
        length=length,
        part=size + PART_OVERHEAD,
        starts=(fast_start((size,) * len(ids)),),
        ids=bytes(ids),
        well=bytes(len(ids)),
        heads=Struct(f"<{BEFORE_PARTS}s{length - BEFORE_PARTS}x").unpack,
        summed=Struct(f"<{BEFORE_PARTS + body}s" + f"{2 + body}s" * more + "2x").unpack,
        crcs=Struct(f"<{BEFORE_PARTS}x" + f"{body}xH" * len(ids)).unpack,
        values=Struct(f"<{BEFORE_PARTS}x" + f"2x{size}s2x" * len(ids)).unpack,
    )


@lru_cache(LAYOUTS)
def _frames(ids: tuple[int, ...], size: int) -> _Layout:
    whole = protocol2.STATUS_BYTES + size
    length = (whole - protocol2.OVERHEAD).to_bytes(2, "little")
    return _Layout(
        length=whole * len(ids),
        part=whole,
        starts=tuple(protocol2.HEADER + bytes((device,)) + length + bytes((STATUS,)) for device in ids),
        ids=bytes(ids),
        well=bytes(len(ids)),
        heads=Struct("<" + f"{_BEFORE_ERROR}s{whole - _BEFORE_ERROR}x" * len(ids)).unpack,
        summed=Struct("<" + f"{whole - 2}s2x" * len(ids)).unpack,
        crcs=Struct("<" + f"{whole - 2}xH" * len(ids)).unpack,
        values=Struct("<" + f"{_BEFORE_ERROR + 1}x{size}s2x" * len(ids)).unpack,
    )
