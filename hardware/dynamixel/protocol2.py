"""Protocol 2.0 as pure functions over bytes: frames, byte stuffing, CRC (e-Manual, Protocol 2.0).

FF FF FD 00 | ID | LEN_L LEN_H | INST | PARAM... | CRC_L CRC_H
"""

from collections.abc import Iterable, Sequence

from fastcrc.crc16 import umts

from hardware.dynamixel.packets import BROADCAST, MAX_ID, STATUS, Frame, Instruction, Status

HEADER = b"\xff\xff\xfd\x00"
OVERHEAD = 7
"""Bytes before LEN counts: header, id and LEN itself."""
MAX_LENGTH = 8192
"""Longest frame body (LEN) that is built or accepted; more is noise."""
STATUS_BYTES = 11
"""A status frame without data."""

STUFFED = b"\xff\xff\xfd\xfd"
"""What stuffing makes of a header's first three bytes."""

PATTERN = b"\xff\xff\xfd"
"""Nowhere in a frame but at its beginning, and where stuffing follows."""


def stuff(body: bytes) -> bytes:
    """Body (instruction to last parameter) in which no header can appear: FF FF FD becomes FF FF FD FD."""
    return body.replace(PATTERN, STUFFED) if PATTERN in body else body


def unstuff(body: bytes) -> bytes:
    """Inverse of `stuff`."""
    return body.replace(STUFFED, PATTERN) if STUFFED in body else body


def frame(device: int, code: int, params: bytes = b"") -> bytes:
    """A whole frame. Raises ValueError for an id or a length that does not exist."""
    if not 0 <= device <= BROADCAST or device == 0xFD:
        raise ValueError(f"id {device}; allowed: 0 to 252, and 254 for all")
    return _closed(device, stuff(bytes((code,)) + params))


def status(device: int, error: int = 0, data: bytes = b"") -> bytes:
    """The status frame of one device."""
    return frame(device, STATUS, bytes((error,)) + data)


def status_of(received: Frame) -> Status | None:
    """The status of one device in a frame; None for an instruction (of an adapter that echoes, say) and for the reply
    to a fast read, which holds several."""
    if received.code != STATUS or not received.params or received.id == BROADCAST:
        return None
    return Status(received.id, received.params[0], received.params[1:])


def ping(device: int) -> bytes:
    """Ping; all devices answer a broadcast, in order of their ids."""
    return frame(device, Instruction.PING)


def write(device: int, address: int, data: bytes) -> bytes:
    """Write `data` to `address`."""
    return frame(device, Instruction.WRITE, _word(address) + data)


def sync_read(address: int, length: int, ids: Iterable[int], *, fast: bool = False) -> bytes:
    """Read the same registers of several devices: one status frame each, or (fast) one for all."""
    code = Instruction.FAST_SYNC_READ if fast else Instruction.SYNC_READ
    return frame(BROADCAST, code, _span(address, length) + _members(ids))


def sync_write(address: int, length: int, items: Iterable[tuple[int, bytes]]) -> bytes:
    """Write the same registers of several devices; none answers. Raises ValueError for data of another length."""
    return frame(BROADCAST, Instruction.SYNC_WRITE, _span(address, length) + _items(items, length))


def _closed(device: int, body: bytes) -> bytes:
    length = len(body) + 2
    if length > MAX_LENGTH:
        raise ValueError(f"a frame of {length} bytes; allowed: {MAX_LENGTH}")
    out = HEADER + bytes((device,)) + length.to_bytes(2, "little") + body
    return out + umts(out, 0).to_bytes(2, "little")


def _word(value: int) -> bytes:
    if not 0 <= value <= 0xFFFF:
        raise ValueError(f"address or length {value}; allowed: 0 to 65535")
    return value.to_bytes(2, "little")


def _span(address: int, length: int) -> bytes:
    return _word(address) + _word(length)


def _members(ids: Iterable[int]) -> bytes:
    """Ids of a group: those of single devices."""
    members = bytes(ids)
    if members and max(members) > MAX_ID:
        raise ValueError(f"id {max(members)} in a group; allowed: 0 to {MAX_ID}")
    return members


def _items(items: Iterable[tuple[int, bytes]], length: int) -> bytes:
    out = bytearray()
    for device, data in items:
        if len(data) != length:
            raise ValueError(f"{len(data)} bytes for device {device}; allowed: {length}")
        out.append(device)
        out += data
    _members(out[:: length + 1])
    return bytes(out)


# The one reply of a Fast Sync or Fast Bulk Read, part by part: the parts before a gap are valid.

BEFORE_PARTS = 8
"""Bytes before the first part: header, id, LEN, instruction."""
PART_OVERHEAD = 4
"""Bytes of a part in addition to its data: error, id, CRC."""


def fast_length(sizes: Sequence[int]) -> int:
    """Bytes of the whole reply with so many bytes of data in each part."""
    return BEFORE_PARTS + sum(sizes) + PART_OVERHEAD * len(sizes)


def fast_start(sizes: Sequence[int]) -> bytes:
    """The bytes before the first part."""
    length = fast_length(sizes) - OVERHEAD
    return HEADER + bytes((BROADCAST,)) + length.to_bytes(2, "little") + bytes((STATUS,))


def valid_parts(reply: bytes, sizes: Sequence[int]) -> list[Status]:
    """The parts of a reply, maybe incomplete or damaged, up to the first that is not complete and valid.

    reply: from its header on. sizes: bytes of data of each part, as asked. Each part's CRC runs over everything sent
    so far, earlier CRCs included (e-Manual, Fast Sync Read).
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
