"""Protocol 1.0 as pure functions over bytes (e-Manual, Protocol 1.0).

FF FF | ID | LEN | INST or ERR | PARAM... | CHK          LEN = parameters + 2
"""

from collections.abc import Iterable

from hardware.dynamixel.packets import BROADCAST, Frame, Instruction, Status

HEADER = b"\xff\xff"
OVERHEAD = 4
"""Bytes before LEN counts: header, id and LEN itself."""
STATUS_BYTES = 6
"""A status frame without data."""
MAX_PARAMS = 253


def checksum(content: bytes) -> int:
    """Checksum of everything after the header: the inverted sum."""
    return ~sum(content) & 0xFF


def frame(device: int, code: int, params: bytes = b"") -> bytes:
    """A whole frame; `code` is the instruction, or the error byte of a status. Raises ValueError for an id or a length
    that does not exist."""
    if not 0 <= device <= BROADCAST:
        raise ValueError(f"id {device}; allowed: 0 to 253, and 254 for all")
    if len(params) > MAX_PARAMS:
        raise ValueError(f"{len(params)} parameters; allowed: {MAX_PARAMS}")
    content = bytes((device, len(params) + 2, code)) + params
    return HEADER + content + bytes((checksum(content),))


def status(device: int, error: int = 0, data: bytes = b"") -> bytes:
    """The status frame of one device."""
    return frame(device, error, data)


def status_of(received: Frame) -> Status:
    """Read a frame as a status; a 1.0 frame does not show whether it is one."""
    return Status(received.id, received.code, received.params)


def ping(device: int) -> bytes:
    """Ping."""
    return frame(device, Instruction.PING)


def read(device: int, address: int, length: int) -> bytes:
    """Read `length` bytes from `address`."""
    return frame(device, Instruction.READ, bytes((address, length)))


def write(device: int, address: int, data: bytes) -> bytes:
    """Write `data` to `address`."""
    return frame(device, Instruction.WRITE, bytes((address,)) + data)


def sync_write(address: int, length: int, items: Iterable[tuple[int, bytes]]) -> bytes:
    """Write the same registers of several devices; none answers. Raises ValueError for data of another length."""
    params = bytearray((address, length))
    for device, data in items:
        if len(data) != length:
            raise ValueError(f"{len(data)} bytes for device {device}; allowed: {length}")
        params += _member(device)
        params += data
    return frame(BROADCAST, Instruction.SYNC_WRITE, bytes(params))


def bulk_read(items: Iterable[tuple[int, int, int]]) -> bytes:
    """Read registers (id, address, length) of several MX devices; one status each, in order."""
    params = b"\x00" + b"".join(bytes((length, *_member(device), address)) for device, address, length in items)
    return frame(BROADCAST, Instruction.BULK_READ, params)


def _member(device: int) -> bytes:
    """Id of one device in a group."""
    if not 0 <= device < BROADCAST:
        raise ValueError(f"id {device} in a group; allowed: 0 to {BROADCAST - 1}")
    return bytes((device,))
