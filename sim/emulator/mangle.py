"""Faults of single packets: bytes in, other bytes out, some of them later."""

import random
from collections.abc import Sequence
from typing import NamedTuple

from sim.emulator.faults import Fault, FaultKind, Unit


class Part(NamedTuple):
    """Bytes of a packet that come `delay` s after what is in front of them."""

    delay: float
    data: bytes


def mangled(packet: bytes, faults: Sequence[Fault], chance: random.Random) -> list[Part]:
    """What becomes of a packet by faults of BYTE_KINDS, in their order; nothing: it is lost."""
    parts = [Part(0.0, packet)]
    for fault in faults:
        parts = [new for part in parts for new in _hit(part, fault, chance, last=packet[-1])]
    return [part for part in parts if part.data]


def _hit(part: Part, fault: Fault, chance: random.Random, *, last: int) -> list[Part]:
    """last: byte of the packet as it was said; two storms leave it as wrong as one."""
    if fault.unit is Unit.BYTES:
        return _hit_bytes(part, fault, chance)
    if chance.random() >= fault.rate or not part.data:
        return [part]
    delay, data = part
    match fault.kind:
        case FaultKind.DROP:
            return []
        case FaultKind.FLIP:
            at = chance.randrange(len(data))
            data = data[:at] + _flipped(data[at], chance) + data[at + 1 :]
        case FaultKind.DUPLICATE:
            data += data
        case FaultKind.LATE:
            delay += fault.amount
        case FaultKind.NOISE:
            data = _noise(fault, chance) + data
        case FaultKind.CRC_STORM:
            data = data[:-1] + bytes((last ^ 0xFF,))
    return [Part(delay, data)]


def _hit_bytes(part: Part, fault: Fault, chance: random.Random) -> list[Part]:
    """Each byte for itself: it may be lost, changed, come twice, or keep what follows waiting."""
    out: list[Part] = []
    delay, done = part.delay, bytearray()
    for byte in part.data:
        own = bytes((byte,))
        if chance.random() < fault.rate:
            match fault.kind:
                case FaultKind.DROP:
                    own = b""
                case FaultKind.FLIP:
                    own = _flipped(byte, chance)
                case FaultKind.DUPLICATE:
                    own += own
                case FaultKind.NOISE:
                    own = _noise(fault, chance) + own
                case FaultKind.LATE:
                    out.append(Part(delay, bytes(done)))
                    delay, done = fault.amount, bytearray()
        done += own
    return [*out, Part(delay, bytes(done))]


def _flipped(byte: int, chance: random.Random) -> bytes:
    return bytes((byte ^ 1 << chance.randrange(8),))


def _noise(fault: Fault, chance: random.Random) -> bytes:
    return chance.randbytes(chance.randint(1, int(fault.amount)))
