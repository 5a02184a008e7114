"""The reply to a group read of protocol 2.0 when all of it is there and sound, checked in one go: what nearly every
cycle sees."""

from collections.abc import Callable
from functools import lru_cache
from struct import Struct
from typing import NamedTuple

from fastcrc.crc16 import umts

from hardware.dynamixel import protocol2
from hardware.dynamixel.answers import Answers
from hardware.dynamixel.fast_status import BEFORE_PARTS, PART_OVERHEAD, fast_length, fast_start
from hardware.dynamixel.packets import ALERT, STATUS

LAYOUTS = 512
"""Different requests that are remembered."""
_BEFORE_ERROR = 8
"""Bytes of a status frame before its error byte: header, id, LEN, instruction."""

Cut = Callable[[bytes], tuple[bytes, ...]]
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
    heads: Cut
    summed: Cut
    crcs: Callable[[bytes], tuple[int, ...]]
    values: Cut


def whole_reply(reply: bytes, ids: tuple[int, ...], size: int) -> Answers | None:
    """Answers of all `ids` to a Fast Sync Read of `size` bytes of each; None for a reply that is not whole and sound.

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
    """Answers of all `ids` to a Sync Read of `size` bytes of each, a frame each; None for a reply that is not whole and
    sound, in this order, or that has stuffing in it."""
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
