"""What a group instruction asks of each device, read from its parameters; what is cut short asks of nobody."""

from functools import lru_cache
from struct import iter_unpack
from typing import NamedTuple

from hardware.dynamixel.packets import Instruction


class ReadItem(NamedTuple):
    """One device's part of a group read."""

    id: int
    address: int
    length: int


class WriteItem(NamedTuple):
    """One device's part of a group write."""

    id: int
    address: int
    data: bytes


GROUP_READS2 = frozenset(
    (Instruction.SYNC_READ, Instruction.BULK_READ, Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ)
)
"""Instructions of protocol 2.0 that many answer in turn."""
FAST_READS = frozenset((Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ))
"""Those of them that are answered by one frame."""
GROUP_READS1 = frozenset((Instruction.BULK_READ,))
"""As GROUP_READS2, of protocol 1.0."""
GROUP_WRITES = frozenset((Instruction.SYNC_WRITE, Instruction.BULK_WRITE))
"""Instructions that many obey and nobody answers (bulk write: 2.0 only)."""
REQUESTS = 64
"""Different read requests that are remembered: a host repeats a few."""


@lru_cache(REQUESTS)
def reads2(code: int, params: bytes) -> tuple[ReadItem, ...]:
    """Parts of a group read of protocol 2.0, in the order of the frame."""
    if code in (Instruction.SYNC_READ, Instruction.FAST_SYNC_READ):
        address, length = _word(params, 0), _word(params, 2)
        return tuple(ReadItem(device, address, length) for device in params[4:])
    ends = range(0, len(params) - 4, 5)
    return tuple(ReadItem(params[at], _word(params, at + 1), _word(params, at + 3)) for at in ends)


@lru_cache(REQUESTS)
def reads1(params: bytes) -> tuple[ReadItem, ...]:
    """Parts of a bulk read of protocol 1.0 (00, then length, id, address), in the order of the frame."""
    return tuple(ReadItem(params[at + 1], params[at + 2], params[at]) for at in range(1, len(params) - 2, 3))


def writes2(code: int, params: bytes) -> list[WriteItem]:
    """Parts of a group write of protocol 2.0."""
    if len(params) < 4:
        return []
    if code == Instruction.SYNC_WRITE:
        return _same_registers(params[4:], _word(params, 0), _word(params, 2))
    items, at = [], 0
    while at + 5 <= len(params):
        begin = at + 5
        end = begin + _word(params, at + 3)
        if end > len(params):
            break
        items.append(WriteItem(params[at], _word(params, at + 1), params[begin:end]))
        at = end
    return items


def writes1(params: bytes) -> list[WriteItem]:
    """Parts of a sync write of protocol 1.0."""
    return _same_registers(params[2:], params[0], params[1]) if len(params) >= 2 else []


def _same_registers(rest: bytes, address: int, length: int) -> list[WriteItem]:
    whole = rest[: len(rest) - len(rest) % (length + 1)]
    return [WriteItem(device, address, data) for device, data in iter_unpack(f"B{length}s", whole)]


def _word(params: bytes, at: int) -> int:
    return int.from_bytes(params[at : at + 2], "little")
