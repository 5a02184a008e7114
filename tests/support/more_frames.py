"""Frames that no part of the product sends, for tests of parsers, driver and emulator (e-Manual, both protocols)."""

from collections.abc import Iterable, Sequence

from fastcrc.crc16 import umts

from hardware.dynamixel.codec import BROADCAST, STATUS, Instruction, Status, protocol2


def crc(data: bytes, before: int = 0) -> int:
    """CRC-16 of `data` (CRC-16/UMTS: polynomial 0x8005, no reflection), going on from `before`."""
    return umts(data, before)


def fast_status(answers: Sequence[Status]) -> bytes:
    """The one status frame of a Fast Sync Read or Fast Bulk Read: parts in order, not stuffed, each closed by the CRC
    of everything so far (the last is the frame's)."""
    length = 1 + sum(len(answer.data) + 4 for answer in answers)
    if not 1 < length <= protocol2.MAX_LENGTH:
        raise ValueError(
            f"a fast status of {len(answers)} parts, {length} bytes; "
            f"allowed: 1 part or more, {protocol2.MAX_LENGTH} bytes"
        )
    out = bytearray(protocol2.HEADER + bytes((BROADCAST,)) + length.to_bytes(2, "little") + bytes((STATUS,)))
    total, done = 0, 0
    for answer in answers:
        out += bytes((answer.error, answer.id)) + answer.data
        total = crc(bytes(out[done:]), total)
        done = len(out)
        out += total.to_bytes(2, "little")
    return bytes(out)


def read(device: int, address: int, length: int) -> bytes:
    """Read `length` bytes from `address`."""
    return protocol2.frame(device, Instruction.READ, _words(address, length))


def reboot(device: int) -> bytes:
    """Restart the device."""
    return protocol2.frame(device, Instruction.REBOOT)


def bulk_read(items: Iterable[tuple[int, int, int]], *, fast: bool = False) -> bytes:
    """Read registers (id, address, length) of several devices."""
    params = b"".join(bytes((device,)) + _words(address, length) for device, address, length in items)
    return protocol2.frame(BROADCAST, Instruction.FAST_BULK_READ if fast else Instruction.BULK_READ, params)


def bulk_write(items: Iterable[tuple[int, int, bytes]]) -> bytes:
    """Write registers (id, address, data) of several devices; none answers."""
    params = b"".join(bytes((device,)) + _words(address, len(data)) + data for device, address, data in items)
    return protocol2.frame(BROADCAST, Instruction.BULK_WRITE, params)


def _words(*values: int) -> bytes:
    return b"".join(value.to_bytes(2, "little") for value in values)
