"""Raw datagrams as recorded: `UDPREC01`, then records of u64 Unix ns, u16 port, u32 length, payload (little-endian).

A file may be compressed by gzip.
"""

import gzip
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from struct import Struct
from typing import IO

from retarget.errors import InputError
from retarget.sources.stream_frame import MAX_DATAGRAM

__all__ = ["MAX_RECORDS", "UdpRecord", "read_udprec"]

MAX_RECORDS = 10_000_000
"""Records of one file: a day of 100 Hz. A file with more is refused."""

MAGIC = b"UDPREC01"
_HEAD = Struct("<QHI")
_GZIP = b"\x1f\x8b"


@dataclass(frozen=True, slots=True)
class UdpRecord:
    """One datagram. wall: when it arrived, s since 1970 of the recorder's clock. port: it was sent to."""

    wall: float
    port: int
    payload: bytes


def read_udprec(path: Path) -> Iterator[UdpRecord]:
    """The datagrams of a file, one at a time, in its order. Raises InputError for a file that is none, or cut short."""
    try:
        with path.open("rb") as raw:
            packed = raw.read(len(_GZIP)) == _GZIP
            raw.seek(0)
            if packed:
                with gzip.open(raw, "rb") as opened:
                    yield from _records(opened, str(path))
            else:
                yield from _records(raw, str(path))
    except (OSError, EOFError, zlib.error) as error:
        raise InputError("recording cannot be read", where=str(path), found=error) from error


def _records(stream: "IO[bytes] | gzip.GzipFile", where: str) -> Iterator[UdpRecord]:
    if stream.read(len(MAGIC)) != MAGIC:
        raise InputError("this is no recording of datagrams", where=where, allowed="a file that begins with UDPREC01")
    for number in range(MAX_RECORDS + 1):
        head = stream.read(_HEAD.size)
        if not head:
            return
        if number == MAX_RECORDS:
            break
        place = f"{where}: record {number + 1}"
        if len(head) < _HEAD.size:
            raise InputError("recording is cut short", where=place)
        nanoseconds, port, length = _HEAD.unpack(head)
        if length > MAX_DATAGRAM:
            raise InputError(
                "datagram is too long", where=place, found=f"{length} B", allowed=f"up to {MAX_DATAGRAM} B"
            )
        payload = stream.read(length)
        if len(payload) < length:
            raise InputError("recording is cut short", where=place)
        yield UdpRecord(nanoseconds * 1e-9, port, payload)
    raise InputError("recording is too long", where=where, allowed=f"up to {MAX_RECORDS} datagrams")
