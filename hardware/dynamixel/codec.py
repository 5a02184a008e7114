"""The wire codec of Dynamixel protocols 1.0 and 2.0: frames, statuses and parsers, as pure functions over bytes.

1.0: FF FF | ID | LEN | INST or ERR | PARAM... | CHK                          LEN = parameters + 2
2.0: FF FF FD 00 | ID | LEN_L LEN_H | INST | PARAM... | CRC_L CRC_H           with byte stuffing (e-Manual)
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from functools import lru_cache
from struct import Struct
from typing import Any, NamedTuple

from fastcrc.crc16 import umts

BROADCAST = 0xFE
MAX_ID = 252
"""Highest device id in protocol 2.0 (1.0: 253)."""
STATUS = 0x55
"""Code of a 2.0 status frame."""
ALERT = 0x80
"""Bit 7 of a 2.0 error byte: a hardware error. The data are valid."""


class Instruction(IntEnum):
    """Instruction codes (e-Manual, protocols 1.0 and 2.0)."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    CLEAR = 0x10
    CONTROL_TABLE_BACKUP = 0x20
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    BULK_WRITE = 0x93
    FAST_BULK_READ = 0x9A


class Error2(IntEnum):
    """Error number of a 2.0 status frame, bits 0 to 6."""

    NONE = 0
    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


class Error1(IntFlag):
    """Error bits of a 1.0 status frame."""

    INPUT_VOLTAGE = 0x01
    ANGLE_LIMIT = 0x02
    OVERHEATING = 0x04
    RANGE = 0x08
    CHECKSUM = 0x10
    OVERLOAD = 0x20
    INSTRUCTION = 0x40


class WireFrame(NamedTuple):
    """One valid frame, without stuffing. code: the instruction, STATUS (2.0), or the error byte of a 1.0 status."""

    id: int
    code: int
    params: bytes


class Status(NamedTuple):
    """Answer of one device."""

    id: int
    error: int
    data: bytes


class Codec(ABC):
    """Frames of one protocol. Raises ValueError for an impossible id, address or length."""

    WIDTH: int
    """Bytes of an address and of a length."""
    MOST_MEMBERS: int
    """Highest id of a device in a group."""

    HEADER: bytes
    STATUS_BYTES: int
    """Bytes of a status frame without data."""

    @abstractmethod
    def frame(self, device: int, code: int, params: bytes = b"") -> bytes:
        """A whole frame. code: the instruction."""

    def ping(self, device: int) -> bytes:
        """Ping. All 2.0 devices answer a broadcast, in order of their ids."""
        return self.frame(device, Instruction.PING)

    def read(self, device: int, address: int, length: int) -> bytes:
        """Read `length` bytes from `address`."""
        return self.frame(device, Instruction.READ, self.number(address) + self.number(length))

    def write(self, device: int, address: int, data: bytes) -> bytes:
        """Write `data` to `address`."""
        return self.frame(device, Instruction.WRITE, self.number(address) + data)

    def sync_write(self, address: int, length: int, items: Iterable[tuple[int, bytes]]) -> bytes:
        """Write the same registers of several devices, without answers."""
        params = bytearray(self.number(address) + self.number(length))
        for device, data in items:
            if len(data) != length:
                raise ValueError(f"{len(data)} bytes for device {device}; allowed: {length}")
            params += self.members([device])
            params += data
        return self.frame(BROADCAST, Instruction.SYNC_WRITE, bytes(params))

    def number(self, value: int) -> bytes:
        """Encode an address or a length."""
        highest = (1 << 8 * self.WIDTH) - 1
        if not 0 <= value <= highest:
            raise ValueError(f"address or length {value}; allowed: 0 to {highest}")
        return value.to_bytes(self.WIDTH, "little")

    def members(self, ids: Iterable[int]) -> bytes:
        """Encode the ids of a group."""
        members = bytes(ids)
        if members and max(members) > self.MOST_MEMBERS:
            raise ValueError(f"id {max(members)} in a group; allowed: 0 to {self.MOST_MEMBERS}")
        return members


class Protocol1(Codec):
    """Protocol 1.0 (e-Manual)."""

    HEADER = b"\xff\xff"
    OVERHEAD = 4
    """Bytes before those that LEN counts."""
    STATUS_BYTES = 6
    MAX_PARAMS = 253
    WIDTH, MOST_MEMBERS = 1, MAX_ID + 1

    def frame(self, device: int, code: int, params: bytes = b"") -> bytes:
        """A whole frame. code: the instruction, or the error byte of a status."""
        if not 0 <= device <= BROADCAST:
            raise ValueError(f"id {device}; allowed: 0 to 253, and 254 for all")
        if len(params) > self.MAX_PARAMS:
            raise ValueError(f"{len(params)} parameters; allowed: {self.MAX_PARAMS}")
        content = bytes((device, len(params) + 2, code)) + params
        return self.HEADER + content + bytes((~sum(content) & 0xFF,))  # checksum: the inverted sum

    def status(self, device: int, error: int = 0, data: bytes = b"") -> bytes:
        """See `Protocol2`."""
        return self.frame(device, error, data)

    def status_of(self, received: WireFrame) -> Status | None:
        """A frame as a status, which 1.0 does not mark."""
        return Status(received.id, received.code, received.params)

    def bulk_read(self, items: Iterable[tuple[int, int, int]]) -> bytes:
        """Read registers (id, address, length) of several MX devices, which answer in order."""
        params = b"\x00" + b"".join(
            bytes((length, *self.members([device]), address)) for device, address, length in items
        )
        return self.frame(BROADCAST, Instruction.BULK_READ, params)

    def parser(self) -> "Parser":
        """See `Protocol2`. The checksum passes one of 256 damaged frames."""
        return Parser(_scan1)


class Protocol2(Codec):
    """Protocol 2.0. Byte stuffing (FF FF FD becomes FF FF FD FD) keeps headers out of a body (instruction to last
    parameter)."""

    HEADER = b"\xff\xff\xfd\x00"
    OVERHEAD = 7
    """Bytes before those that LEN counts."""
    STATUS_BYTES = 11
    MAX_LENGTH = 8192
    """Longest LEN built or accepted."""
    PATTERN = b"\xff\xff\xfd"
    STUFFED = b"\xff\xff\xfd\xfd"
    WIDTH, MOST_MEMBERS = 2, MAX_ID

    def stuff(self, body: bytes) -> bytes:
        """Stuff the body of a frame."""
        return body.replace(self.PATTERN, self.STUFFED) if self.PATTERN in body else body

    def unstuff(self, body: bytes) -> bytes:
        """Undo `stuff`."""
        return body.replace(self.STUFFED, self.PATTERN) if self.STUFFED in body else body

    def frame(self, device: int, code: int, params: bytes = b"") -> bytes:
        """A whole frame. code: the instruction."""
        if not 0 <= device <= BROADCAST or device == 0xFD:
            raise ValueError(f"id {device}; allowed: 0 to 252, and 254 for all")
        body = self.stuff(bytes((code,)) + params)
        length = len(body) + 2
        if length > self.MAX_LENGTH:
            raise ValueError(f"a frame of {length} bytes; allowed: {self.MAX_LENGTH}")
        out = self.HEADER + bytes((device,)) + length.to_bytes(2, "little") + body
        return out + umts(out, 0).to_bytes(2, "little")

    def status(self, device: int, error: int = 0, data: bytes = b"") -> bytes:
        """The status frame of a device."""
        return self.frame(device, STATUS, bytes((error,)) + data)

    def status_of(self, received: WireFrame) -> Status | None:
        """A status; None for an instruction or a fast reply."""
        if received.code != STATUS or not received.params or received.id == BROADCAST:
            return None
        return Status(received.id, received.params[0], received.params[1:])

    def sync_read(self, address: int, length: int, ids: Iterable[int], *, fast: bool = False) -> bytes:
        """Read the same registers of several devices: a status each, or (fast) one for all."""
        code = Instruction.FAST_SYNC_READ if fast else Instruction.SYNC_READ
        return self.frame(BROADCAST, code, self.number(address) + self.number(length) + self.members(ids))

    def parser(self) -> "Parser":
        """A parser."""
        return Parser(_scan2)


protocol1, protocol2 = Protocol1(), Protocol2()
CODECS: dict[int, Protocol1 | Protocol2] = {1: protocol1, 2: protocol2}  # by number of the protocol


class ScanResult(NamedTuple):
    """used: bytes of all `frames`. at: start of an incomplete frame, or the end. clear: bytes from there without a
    second header."""

    frames: list[WireFrame]
    used: int
    at: int
    clear: int


Scan = Callable[[bytes, int], ScanResult]
"""Scans bytes, the first so many of which hold no second header."""


class Parser:
    """Incremental parser of one protocol. It holds less than one frame, and its frames do not depend on the pieces."""

    def __init__(self, scan: Scan) -> None:
        self._scan = scan
        self.pending = b""
        """Bytes that may still become a frame."""
        self._clear = 0
        self.skipped = 0
        """Bytes without a valid frame so far."""

    def reset(self) -> None:
        """Discard pending bytes."""
        self.skipped += len(self.pending)
        self.pending, self._clear = b"", 0

    def feed(self, data: bytes | bytearray) -> list[WireFrame]:
        """The frames that `data` completes."""
        buffer = self.pending + data
        frames, used, at, self._clear = self._scan(buffer, self._clear)
        self.skipped += at - used
        self.pending = buffer[at:]
        return frames

    def flush(self) -> list[WireFrame]:
        """The frames inside an unfinished one once the line is silent."""
        frames: list[WireFrame] = []
        while self.pending:
            behind = self.pending[1:]
            self.skipped += 1
            self.pending, self._clear = b"", 0
            frames += self.feed(behind)
        return frames


_ID_AND_LENGTH_2 = Struct("<BH").unpack_from
_CRC = Struct("<H").unpack_from


def _scan2(buffer: bytes, clear: int) -> ScanResult:
    """Scan for 2.0 frames. Stuffing keeps headers out of a body, so one inside ends a broken frame. A fast status is
    not stuffed, so only its length shows its end."""
    header, overhead = protocol2.HEADER, protocol2.OVERHEAD
    frames: list[WireFrame] = []
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
            return ScanResult(frames, used, at, (behind if behind >= 0 else size - len(header) + 1) - at)
        elif umts(buffer[at:close], 0) != _CRC(buffer, close)[0]:
            at = behind
        else:
            if stuffed is None:
                stuffed = protocol2.STUFFED in buffer  # once, not for every frame: it seldom is
            content = protocol2.unstuff(buffer[body:close]) if stuffed and not fast else buffer[body:close]
            frames.append(WireFrame(device, content[0], content[1:]))
            begin = close + 2
            used += begin - at
            at = behind if behind < 0 or behind >= begin else buffer.find(header, begin)
    return ScanResult(frames, used, at if at >= 0 else _tail(buffer, begin, header), 0)


def _scan1(buffer: bytes, _clear: int) -> ScanResult:
    """Scan for 1.0 frames. A body may hold any bytes, so only its length shows its end."""
    header, overhead = protocol1.HEADER, protocol1.OVERHEAD
    frames: list[WireFrame] = []
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
            frames.append(WireFrame(device, buffer[at + 4], buffer[at + 5 : close]))
            begin = close + 1
            used += begin - at
            at = buffer.find(header, begin)
    return ScanResult(frames, used, at if at >= 0 else _tail(buffer, begin, header), 0)


def _tail(buffer: bytes, begin: int, header: bytes) -> int:
    size = len(buffer)
    for count in range(len(header) - 1, 0, -1):
        if size - begin >= count and buffer.endswith(header[:count]):
            return size - count
    return size


# The reply to a Fast Sync or Fast Bulk Read. The parts before a gap are valid.

BEFORE_PARTS = 8
"""Bytes of a fast reply before its parts: header, id, LEN, instruction."""
PART_OVERHEAD = 4
"""Bytes of a part beyond its data: error, id, CRC."""


def fast_length(sizes: Sequence[int]) -> int:
    """The length of a fast reply for these data bytes per part."""
    return BEFORE_PARTS + sum(sizes) + PART_OVERHEAD * len(sizes)


def fast_start(sizes: Sequence[int]) -> bytes:
    """Return its first bytes."""
    length = fast_length(sizes) - protocol2.OVERHEAD
    return protocol2.HEADER + bytes((BROADCAST,)) + length.to_bytes(2, "little") + bytes((STATUS,))


def valid_parts(reply: bytes, sizes: Sequence[int]) -> list[Status]:
    """The parts of a fast reply, from its header on, up to the first incomplete or damaged one. sizes: data
    bytes per part.

    Each part's CRC covers everything before it, earlier CRCs included (e-Manual, Fast Sync Read).
    """
    if not reply.startswith(fast_start(sizes)):
        return []
    parts: list[Status] = []
    at, total, begun = BEFORE_PARTS, 0, 0
    for size in sizes:
        end = at + 2 + size
        if len(reply) < end + 2:
            break
        total = umts(reply[begun:end], total)
        if total != reply[end] | reply[end + 1] << 8:
            break
        parts.append(Status(reply[at + 1], reply[at], reply[at + 2 : end]))
        begun, at = end, end + 2
    return parts


@dataclass(frozen=True, slots=True)
class Answers:
    """Answers of k servos in the order of arrival: error bytes (k), data (k * size)."""

    ids: tuple[int, ...] = ()
    errors: bytes = b""
    data: bytes = b""

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def statuses(self) -> list[Status]:
        """The answers one by one."""
        size = len(self.data) // len(self.ids) if self.ids else 0
        return [
            Status(device, self.errors[k], self.data[k * size : (k + 1) * size]) for k, device in enumerate(self.ids)
        ]


def side_by_side(statuses: Sequence[Status]) -> Answers:
    """Join answers of equal size."""
    return Answers(
        tuple([status.id for status in statuses]),
        bytes([status.error for status in statuses]),
        b"".join([status.data for status in statuses]),
    )


LAYOUTS = 512  # kept in a cache


class _Layout(NamedTuple):
    """Layout of a fast reply. unpack: splits it into its start, and error byte, id, data and CRC of each servo. summed:
    the bytes that each CRC adds."""

    length: int
    unpack: Callable[[bytes], tuple[Any, ...]]
    begins: bytes
    summed: list[slice]


def whole_reply(reply: bytes, ids: tuple[int, ...], size: int) -> Answers | None:
    """The answers of all `ids` to a Fast Sync Read of `size` bytes; None if incomplete, damaged or refused. See
    `valid_parts`."""
    length, unpack, begins, summed = _layout(ids, size)
    if len(reply) != length:
        return None
    fields = unpack(reply)
    if fields[0] != begins or fields[2::4] != ids:
        return None
    total, totals = 0, []
    for piece in summed:
        total = umts(reply[piece], total)
        totals.append(total)
    errors = fields[1::4]
    if tuple(totals) != fields[4::4] or (any(errors) and any(error & ~ALERT for error in errors)):
        return None
    return Answers(ids, bytes(errors), b"".join(fields[3::4]))


@lru_cache(LAYOUTS)
def _layout(ids: tuple[int, ...], size: int) -> _Layout:
    sizes = (size,) * len(ids)
    ends = [fast_length(sizes[:count]) - 2 for count in range(1, len(ids) + 1)]
    unpack = Struct(f"<{BEFORE_PARTS}s" + f"BB{size}sH" * len(ids)).unpack
    summed = [slice(begin, end) for begin, end in zip([0, *ends], ends, strict=False)]
    return _Layout(fast_length(sizes), unpack, fast_start(sizes), summed)
