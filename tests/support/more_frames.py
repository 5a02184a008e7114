"""Frames that no part of the product sends, for tests of parsers, driver and emulator (e-Manual, both protocols)."""

from collections.abc import Iterable, Sequence

from fastcrc.crc16 import umts

from hardware.dynamixel.codec import BROADCAST, STATUS, Instruction, Status, protocol1, protocol2


def crc(data: bytes, before: int = 0) -> int:
    """CRC-16 of `data` (CRC-16/UMTS: polynomial 0x8005, no reflection), going on from `before`."""
    return umts(data, before)


def summed(data: bytes) -> bytes:
    """`data` with its CRC behind it."""
    return data + crc(data).to_bytes(2, "little")


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


def reg_write(device: int, address: int, data: bytes) -> bytes:
    """Keep a write until Action."""
    return protocol2.frame(device, Instruction.REG_WRITE, _words(address) + data)


def action(device: int) -> bytes:
    """Carry out what Reg Write left."""
    return protocol2.frame(device, Instruction.ACTION)


def factory_reset(device: int, option: int) -> bytes:
    """Reset the control table: 0xFF all of it, 1 all but the id, 2 all but id and baud rate."""
    return protocol2.frame(device, Instruction.FACTORY_RESET, bytes((option,)))


def reboot(device: int) -> bytes:
    """Restart the device."""
    return protocol2.frame(device, Instruction.REBOOT)


def clear_turns(device: int) -> bytes:
    """Clear the turns of the present position."""
    return protocol2.frame(device, Instruction.CLEAR, b"\x01\x44\x58\x4c\x22")


def backup(device: int) -> bytes:
    """Store the control table."""
    return protocol2.frame(device, Instruction.CONTROL_TABLE_BACKUP, b"\x01CTRL")


def restore(device: int) -> bytes:
    """Take back the stored control table."""
    return protocol2.frame(device, Instruction.CONTROL_TABLE_BACKUP, b"\x02CTRL")


def bulk_read(items: Iterable[tuple[int, int, int]], *, fast: bool = False) -> bytes:
    """Read registers (id, address, length) of several devices."""
    params = b"".join(bytes((device,)) + _words(address, length) for device, address, length in items)
    return protocol2.frame(BROADCAST, Instruction.FAST_BULK_READ if fast else Instruction.BULK_READ, params)


def bulk_write(items: Iterable[tuple[int, int, bytes]]) -> bytes:
    """Write registers (id, address, data) of several devices; none answers."""
    params = b"".join(bytes((device,)) + _words(address, len(data)) + data for device, address, data in items)
    return protocol2.frame(BROADCAST, Instruction.BULK_WRITE, params)


def reg_write1(device: int, address: int, data: bytes) -> bytes:
    """Keep a write until Action."""
    return protocol1.frame(device, Instruction.REG_WRITE, bytes((address,)) + data)


def action1(device: int) -> bytes:
    """Carry out what Reg Write left."""
    return protocol1.frame(device, Instruction.ACTION)


def factory_reset1(device: int) -> bytes:
    """Reset the control table."""
    return protocol1.frame(device, Instruction.FACTORY_RESET)


def _words(*values: int) -> bytes:
    return b"".join(value.to_bytes(2, "little") for value in values)
