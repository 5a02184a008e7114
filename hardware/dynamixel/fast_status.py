"""The one reply of a Fast Sync or Fast Bulk Read, part by part: what arrived in front of a gap is still good."""

from collections.abc import Sequence

from fastcrc.crc16 import umts

from hardware.dynamixel import protocol2
from hardware.dynamixel.packets import BROADCAST, STATUS, Status

BEFORE_PARTS = 8
"""Bytes before the first part: header, id, LEN, instruction."""
PART_OVERHEAD = 4
"""Bytes of a part beside its data: error, id, CRC."""


def fast_length(sizes: Sequence[int]) -> int:
    """Bytes of the whole reply with so many bytes of data in each part."""
    return BEFORE_PARTS + sum(sizes) + PART_OVERHEAD * len(sizes)


def fast_start(sizes: Sequence[int]) -> bytes:
    """The bytes before the first part."""
    length = fast_length(sizes) - protocol2.OVERHEAD
    return protocol2.HEADER + bytes((BROADCAST,)) + length.to_bytes(2, "little") + bytes((STATUS,))


def sound_parts(reply: bytes, sizes: Sequence[int]) -> list[Status]:
    """The parts of a reply, maybe cut short or damaged, up to the first that is not whole and sound.

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
