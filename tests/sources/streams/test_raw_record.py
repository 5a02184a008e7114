"""Recordings of datagrams: what was written is read back, and damage costs only what stands behind it."""

import gzip
import os
import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from messages import refuses, shows
from retarget.errors import InputError, UsageError
from retarget.sources.streams.raw_record import MAX_UNWRITTEN, RawReader, RawWriter, RecordedDatagram
from retarget.sources.streams.stream_frame import MAX_DATAGRAM

URL = "vmc://127.0.0.1:39539"
SENT = [
    RecordedDatagram(1.5, 39539, b"first", "127.0.0.1"),
    RecordedDatagram(1.5, 0, b"", "::1"),
    RecordedDatagram(3e5, 65535, bytes(range(256)) * 10, "192.168.1.20"),
]


def write(path: Path, datagrams: list[RecordedDatagram]) -> None:
    writer = RawWriter(path, url=URL)
    for sent in datagrams:
        writer.append(sent.payload, time_ns=round(sent.time_s * 1e9), address=sent.address, port=sent.port)
    writer.close()
    assert (writer.lost, writer.error) == (0, "")


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "a.raw"
    write(path, SENT)
    return path


def test_what_was_written_is_read(recording: Path) -> None:
    reader = RawReader(recording)
    assert reader.url == URL
    assert list(reader) == SENT and reader.damage == ""
    assert list(reader) == SENT  # and again


def test_the_bytes_of_the_format(tmp_path: Path) -> None:
    write(tmp_path / "a", [RecordedDatagram(0.000000258, 513, b"\x07", "1.2.3.4")])
    wanted = b"RAWDGM01" + b"\x15\0" + URL.encode()
    record = bytes.fromhex("0201000000000000 0102 00000000000000000000ffff01020304 01000000 07")
    content = (tmp_path / "a").read_bytes()
    assert content[: len(wanted)] == wanted and content[len(wanted) + 4 :] == record


def test_the_old_format_cut_short(tmp_path: Path) -> None:
    path = tmp_path / "old"
    record = struct.pack("<QHI", 2_000_000_000, 9000, 3) + b"abc"
    path.write_bytes(b"UDPREC01" + record + record[:-1])
    reader = RawReader(path)
    assert list(reader) == [RecordedDatagram(2.0, 9000, b"abc")]
    shows(reader.damage, 2, 25)
    path.write_bytes(b"UDPREC01" + record + struct.pack("<QHI", 0, 0, MAX_DATAGRAM + 1))
    assert len(list(reader)) == 1
    shows(reader.damage, 65537)


def test_every_shortening(recording: Path) -> None:
    """As a crash leaves it: whole records before the cut are there, and the reader says so if one was cut."""
    whole = recording.read_bytes()
    ends, end = [], len(whole)
    for sent in reversed(SENT):
        ends.append(end)
        end -= 34 + len(sent.payload)
    boundaries = [end, *reversed(ends)]
    for length in [*boundaries, *range(boundaries[0], boundaries[-1], 41)]:
        recording.write_bytes(whole[:length])
        reader = RawReader(recording)
        complete = sum(boundary <= length for boundary in boundaries) - 1
        assert list(reader) == SENT[:complete]
        assert (reader.damage == "") == (length in boundaries)


@given(place=st.integers(0, 10_000), bit=st.integers(0, 7))
def test_every_flipped_bit_is_found(tmp_path_factory: pytest.TempPathFactory, place: int, bit: int) -> None:
    path = tmp_path_factory.mktemp("flip") / "a"
    write(path, SENT)
    content = bytearray(path.read_bytes())
    begin = 10 + len(URL)
    place = begin + place % (len(content) - begin)
    content[place] ^= 1 << bit
    path.write_bytes(content)
    reader = RawReader(path)
    found = list(reader)
    assert found == SENT[: len(found)] and len(found) < len(SENT)
    shows(reader.damage, len(found))


def test_a_cut_or_broken_gz(recording: Path) -> None:
    packed = gzip.compress(recording.read_bytes())
    broken = bytearray(packed)
    broken[len(packed) // 2] ^= 0xFF
    for content in (packed[:-9], bytes(broken)):
        recording.write_bytes(content)
        try:
            reader = RawReader(recording)
        except InputError:
            continue
        assert SENT[: len(found := list(reader))] == found and reader.damage


@pytest.mark.parametrize(
    "content", [b"", b"RAW", b"PK\x03\x04 and so on", b"RAWDGM01\xff\xffx", b"RAWDGM01\5\0ab", b"\x1f\x8bxx"]
)
def test_what_is_no_recording(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a"
    path.write_bytes(content)
    with refuses(InputError, path):
        RawReader(path)


def test_a_missing_file_a_folder_and_a_pipe_are_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.raw")
    for path in (tmp_path / "none", tmp_path, tmp_path / "a.raw"):
        with refuses(InputError, path):
            RawReader(path)


def test_the_buffer_is_bounded(tmp_path: Path) -> None:
    writer = RawWriter(tmp_path / "a", url=URL)
    fitting = MAX_UNWRITTEN // (60_000 + 34)
    for number in range(fitting + 10):
        writer.append(bytes(60_000), time_ns=number, address="1.2.3.4", port=5)
    assert writer.lost == 10
    writer.close()
    reader = RawReader(tmp_path / "a")
    assert len(list(reader)) == fitting and reader.damage == ""


def test_a_full_disk_stops_the_recording_only(tmp_path: Path) -> None:
    writer = RawWriter(tmp_path / "a", url=URL)
    writer._file.close()  # as good as a disk that has gone
    writer.append(b"x", time_ns=0, address="1.2.3.4", port=5)
    writer.flush()
    assert writer.error
    writer.append(b"y", time_ns=0, address="1.2.3.4", port=5)
    assert writer.lost == 2


def test_where_nothing_can_be_written(tmp_path: Path, recording: Path) -> None:
    for path in (recording, tmp_path / "none" / "a"):
        with refuses(UsageError, "--record-raw"):
            RawWriter(path, url=URL)
    assert list(RawReader(recording)) == SENT


@given(st.binary(max_size=300), st.booleans())
def test_any_bytes(tmp_path_factory: pytest.TempPathFactory, data: bytes, old: bool) -> None:
    path = tmp_path_factory.mktemp("any") / "a"
    path.write_bytes((b"UDPREC01" if old else b"RAWDGM01\0\0") + data)
    reader = RawReader(path)
    assert sum(len(datagram.payload) for datagram in reader) <= len(data)
