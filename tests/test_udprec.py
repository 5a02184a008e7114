"""Recordings of raw datagrams: read as written, and refused by name where damaged."""

import gzip
import struct
from pathlib import Path

import pytest

from retarget.errors import InputError
from retarget.sources.udprec import MAGIC, UdpRecord, read_udprec

RECORDS = [
    UdpRecord(1_700_000_000.25, 39539, b"abcd"),
    UdpRecord(1_700_000_001.5, 9000, b""),
    UdpRecord(0.0, 0, b"x" * 300),
]


def raw(records: list[UdpRecord]) -> bytes:
    rows = (struct.pack("<QHI", round(r.wall * 1e9), r.port, len(r.payload)) + r.payload for r in records)
    return MAGIC + b"".join(rows)


@pytest.mark.parametrize("packed", [False, True])
def test_round_trip(tmp_path: Path, packed: bool) -> None:
    path = tmp_path / "a.udprec"
    path.write_bytes(gzip.compress(raw(RECORDS), mtime=0) if packed else raw(RECORDS))
    assert list(read_udprec(path)) == RECORDS


def test_golden_bytes(tmp_path: Path) -> None:
    path = tmp_path / "a.udprec"
    path.write_bytes(b"UDPREC01\x00\xca\x9a\x3b\0\0\0\0\x73\x9a\x02\0\0\0hi")
    assert list(read_udprec(path)) == [UdpRecord(1.0, 39539, b"hi")]


def test_an_empty_recording(tmp_path: Path) -> None:
    path = tmp_path / "a.udprec"
    path.write_bytes(MAGIC)
    assert list(read_udprec(path)) == []


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "no recording"),
        (b"UDPREC02", "no recording"),
        (raw(RECORDS)[:-1], "record 3"),
        (raw(RECORDS)[:12], "record 1"),
        (raw(RECORDS) + b"\0", "record 4"),
        (MAGIC + struct.pack("<QHI", 0, 0, 65_537), "65537 B"),
        (gzip.compress(raw(RECORDS), mtime=0)[:-9], "cannot be read"),
        (b"\x1f\x8b nonsense", "cannot be read"),
        (gzip.compress(raw(RECORDS), mtime=0)[:-8] + bytes(8), "cannot be read"),
    ],
)
def test_damage_is_refused_by_name(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "a.udprec"
    path.write_bytes(content)
    with pytest.raises(InputError) as refused:
        list(read_udprec(path))
    assert words in str(refused.value) and "a.udprec" in str(refused.value)


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        list(read_udprec(tmp_path / "none"))


def test_records_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.udprec"
    path.write_bytes(raw(RECORDS))
    monkeypatch.setattr("retarget.sources.udprec.MAX_RECORDS", 3)
    assert len(list(read_udprec(path))) == 3
    monkeypatch.setattr("retarget.sources.udprec.MAX_RECORDS", 2)
    with pytest.raises(InputError, match="too long"):
        list(read_udprec(path))
