"""Recordings of datagrams as received: written during a live run, read by replay.

A file is `RAWDGM01`, u16 length and UTF-8 text of the stream's address, then records, all little-endian:

    u32 CRC-32 of the rest of the record, u64 local monotonic ns, u16 port, 16 bytes IPv6 address of the source (IPv4
    mapped), u32 length, the datagram

The older format `UDPREC01` (records of u64 unix ns, u16 port, u32 length, datagram) is read too, and both as gz.
"""

import gzip
import ipaddress
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from io import BufferedReader
from pathlib import Path
from threading import Lock
from typing import IO, cast

from retarget.errors import InputError, UsageError
from retarget.schema.files import refuse_existing
from retarget.sources.streams.stream_frame import MAX_DATAGRAM

OPTION = "--record-raw"
MAX_UNWRITTEN = 4 * 2**20
"""Bytes that a writer holds before it drops: six seconds of SlimeVR."""
MAX_ADDRESS = 1024
"""Bytes of the longest address of a stream."""

_MAGIC, _OLD_MAGIC, _GZIP = b"RAWDGM01", b"UDPREC01", b"\x1f\x8b"
_RECORD, _CRC = struct.Struct("<QH16sI"), struct.Struct("<I")
_OLD_RECORD = struct.Struct("<QHI")
_LENGTH = struct.Struct("<H")
_UNREADABLE = (OSError, ValueError, EOFError, zlib.error)
"""Errors of a damaged file or packing."""


def is_recording(head: bytes) -> bool:
    """True if a file with these first bytes is a recording, packed or not."""
    if head.startswith(_GZIP):
        try:
            head = zlib.decompressobj(wbits=31).decompress(head, len(_MAGIC))
        except zlib.error:
            return False
    return head.startswith((_MAGIC, _OLD_MAGIC))


@dataclass(frozen=True, slots=True)
class RecordedDatagram:
    """One datagram. time_s: arrival, local monotonic s (unix s in the old format). port, address: of its source
    (address "" in the old format)."""

    time_s: float
    port: int
    payload: bytes
    address: str = ""


class RawWriter:
    """Writer of a recording. `append`, for the tick or a receiving thread, does not touch the disk; `flush`, for a
    slower thread, writes. Neither raises, so that a recording never stops the robot.

    lost: datagrams dropped because the buffer was full or the disk refused them. error: the system's reason, "" if
    none.
    """

    def __init__(self, path: Path, *, url: str) -> None:
        """Start a new file. url: the stream's address. Raises UsageError if it exists or cannot be written."""
        refuse_existing(path, option=OPTION)
        text = url.encode("utf-8")[:MAX_ADDRESS]
        self.lost = 0
        self.error = ""
        self._lock = Lock()
        self._count = 0
        self._unwritten = bytearray(_MAGIC + _LENGTH.pack(len(text)) + text)
        try:
            self._file: IO[bytes] = path.open("xb", buffering=0)
        except (OSError, ValueError) as error:
            raise _unwritable(path, getattr(error, "strerror", None) or str(error)) from None
        self.flush()
        if self.error:
            raise _unwritable(path, self.error)

    def append(self, payload: bytes, *, time_ns: int, address: str, port: int) -> None:
        """Take one datagram. time_ns: local monotonic. address: IPv4 or IPv6, as the socket gave it."""
        record = _RECORD.pack(time_ns, port, _packed(address), len(payload)) + payload
        with self._lock:
            if len(payload) > MAX_DATAGRAM or self.error or len(self._unwritten) + len(record) > MAX_UNWRITTEN:
                self.lost += 1
                return
            self._unwritten += _CRC.pack(zlib.crc32(record))
            self._unwritten += record
            self._count += 1

    def flush(self) -> None:
        """Write all datagrams taken so far."""
        with self._lock:
            taken, self._unwritten = self._unwritten, bytearray()
            count, self._count = self._count, 0
        view = memoryview(taken)
        try:
            while view:
                view = view[self._file.write(view) :]
        except (OSError, ValueError) as error:  # ValueError: closed
            self.error = getattr(error, "strerror", None) or str(error)
            self.lost += count

    def close(self) -> None:
        """Write the rest and close."""
        self.flush()
        self._file.close()


def _unwritable(path: Path, reason: str) -> UsageError:
    return UsageError(f"cannot write this file ({reason})", where=OPTION, found=str(path))


class RawReader:
    """The datagrams of a recording, in order, one record in memory at a time.

    url: of the stream ("" in the old format). damage: after an iteration, where and how the file ended early, "" if
    whole.
    """

    def __init__(self, path: Path) -> None:
        """Raises InputError if the file is missing, unreadable or no recording."""
        self.damage = ""
        self._path = path
        try:
            if path.is_fifo():  # opening it would wait for its writer
                raise InputError("not a recording of datagrams", where=str(path), found="a pipe")
            with path.open("rb") as file:
                self._gz = file.read(len(_GZIP)) == _GZIP
            with self._open() as file:
                self.url, self._old = _header(file, where=str(path))
        except FileNotFoundError:
            raise InputError("no such recording", where=str(path), next_step="Check the path") from None
        except _UNREADABLE as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise InputError("cannot read the recording", where=str(path), found=reason) from None

    def __iter__(self) -> Iterator[RecordedDatagram]:
        self.damage, number, begin = "", 0, 0
        try:
            with self._open() as file:
                _header(file, where=str(self._path))
                while True:
                    begin = file.tell()
                    if not file.peek(1):
                        break
                    yield _record(file, is_old=self._old)
                    number += 1
        except _UNREADABLE as error:
            self.damage = f"{self._path}: record {number + 1}, at byte {begin}: {error}; {number} before it were read"

    def _open(self) -> BufferedReader:
        return cast(BufferedReader, gzip.open(self._path)) if self._gz else self._path.open("rb")


def _take(file: BufferedReader, size: int) -> bytes:
    taken = file.read(size)
    if len(taken) < size:
        raise EOFError("the file ends here, in the middle of a record" if file.tell() else "empty")
    return taken


def _header(file: BufferedReader, *, where: str) -> tuple[str, bool]:
    """Address of the stream, and True for the old format. Raises InputError if it is no recording."""
    magic = _take(file, len(_MAGIC))
    if magic not in (_MAGIC, _OLD_MAGIC):
        allowed = "a file that --record-raw wrote"
        raise InputError("not a recording of datagrams", where=where, found=repr(magic), allowed=allowed)
    if magic == _OLD_MAGIC:
        return "", True
    (length,) = _LENGTH.unpack(_take(file, _LENGTH.size))
    if length > MAX_ADDRESS:
        raise ValueError(f"an address of {length} bytes")
    return _take(file, length).decode("utf-8", "replace"), False


def _record(file: BufferedReader, *, is_old: bool) -> RecordedDatagram:
    """The next record. Raises EOFError or ValueError for damage."""
    if is_old:
        time_ns, port, length = _OLD_RECORD.unpack(_take(file, _OLD_RECORD.size))
        return RecordedDatagram(time_ns * 1e-9, port, _take(file, _checked(length)))
    (crc,) = _CRC.unpack(_take(file, _CRC.size))
    head = _take(file, _RECORD.size)
    time_ns, port, source, length = _RECORD.unpack(head)
    payload = _take(file, _checked(length))
    if zlib.crc32(payload, zlib.crc32(head)) != crc:
        raise ValueError("its CRC is wrong")
    address = ipaddress.IPv6Address(source)
    return RecordedDatagram(time_ns * 1e-9, port, payload, str(address.ipv4_mapped or address))


def _checked(length: int) -> int:
    if length > MAX_DATAGRAM:
        raise ValueError(f"a datagram of {length} bytes")
    return length


@lru_cache(maxsize=64)
def _packed(address: str) -> bytes:
    """16 bytes of an address; zeros if it is none."""
    try:
        parsed = ipaddress.ip_address(address)
    except ValueError:
        return bytes(16)
    return parsed.packed if parsed.version == 6 else b"\0" * 10 + b"\xff\xff" + parsed.packed
