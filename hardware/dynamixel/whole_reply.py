"""The reply to a Fast Sync Read when all of it is there and sound, checked in one go: what nearly every cycle sees."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from fastcrc.crc16 import umts
from numpy.typing import NDArray

from hardware.dynamixel.answers import Answers
from hardware.dynamixel.fast_status import BEFORE_PARTS, PART_OVERHEAD, fast_length, fast_start
from hardware.dynamixel.packets import ALERT

LAYOUTS = 64
"""Different requests that are remembered."""


class _Layout(NamedTuple):
    """start: the reply's first bytes; ids: of the servos; length: of the whole reply.

    crcs (size + 2, 256): what a byte value at a place of a part adds to the part's CRC; places (size + 2,): where the
    row of each place begins. folded (256,): what the CRC before adds, by the exclusive or of its bytes; first: what the
    start adds to the first part's.
    """

    start: bytes
    ids: bytes
    length: int
    places: NDArray[np.intp]
    crcs: NDArray[np.uint16]
    folded: NDArray[np.uint16]
    first: np.uint16


def whole_reply(reply: bytes, ids: tuple[int, ...], size: int) -> Answers | None:
    """Answers of all `ids` to a request for `size` bytes of each; None for a reply that is not whole and sound.

    Each part's CRC goes on from the one before it. That one stands in the reply: where every part is sound, each can be
    checked by itself, from the CRC that it finds there.
    """
    layout = _layout(ids, size)
    if len(reply) != layout.length or not reply.startswith(layout.start):
        return None
    parts = np.frombuffer(reply, np.uint8, offset=BEFORE_PARTS).reshape(len(ids), size + PART_OVERHEAD)
    if parts[:, 1].tobytes() != layout.ids:
        return None
    total = np.bitwise_xor.reduce(layout.crcs.take(parts[:, :-2] + layout.places), axis=1)
    low, high = parts[:, -2], parts[:, -1]
    total[0] ^= layout.first
    total[1:] ^= layout.folded.take(low[:-1] ^ high[:-1])
    if total.astype("<u2").tobytes() != parts[:, -2:].tobytes():
        return None
    errors = parts[:, 0].tobytes()
    if any(errors) and (parts[:, 0] & ~np.uint8(ALERT)).any():  # a refusal: its data mean nothing
        return None
    return Answers(ids, errors, parts[:, 2:-2].tobytes())


@lru_cache(LAYOUTS)
def _layout(ids: tuple[int, ...], size: int) -> _Layout:
    """A CRC without start value is linear: the CRC of a part is the sum (exclusive or) of those of its bytes, each with
    zeros in place of all others; and going on from a value is the same as to add it to the first two bytes."""
    body = size + 2
    crcs, folded = _crcs(size)
    start = fast_start((size,) * len(ids))
    return _Layout(
        start=start,
        ids=bytes(ids),
        length=fast_length((size,) * len(ids)),
        places=256 * np.arange(body),
        crcs=crcs,
        folded=folded,
        first=np.uint16(umts(start + bytes(body), 0)),
    )


@lru_cache(LAYOUTS)
def _crcs(size: int) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """What byte values add at each place of a part, and what the CRC before does, for parts of `size` bytes of data."""
    body = size + 2
    places = [[umts(bytes((value,)) + bytes(body - 1 - at), 0) for value in range(256)] for at in range(body)]
    # The bytes of the CRC before (low, high), added to the value to go on from (high, low): twice the same.
    folded = [umts(bytes((value, value)) + bytes(body), 0) for value in range(256)]
    return np.array(places, np.uint16), np.array(folded, np.uint16)
