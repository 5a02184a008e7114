"""Files that hurt, made by hand: each is one message, in little time and memory. Random ones: `benchmarks.fuzz`."""

import os
import struct
import tracemalloc
import zipfile
from hashlib import sha256
from pathlib import Path

import pytest
import zstandard

from messages import refuses, shows
from recordings import record
from retarget.errors import InputError
from retarget.recording import read_run
from retarget.recording.mcap_writer import METADATA
from retarget.recording.read_run import ROBOT_KEYS
from retarget.recording.reading import MAGIC, read_recording
from retarget.recording.session import FORMAT, Session
from retarget.web.recorded import open_recorded

GIB = 2**30


def record_of(opcode: int, body: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def text(value: bytes) -> bytes:
    return struct.pack("<I", len(value)) + value


def chunk(data: bytes, *, says: int, packing: bytes = b"zstd") -> bytes:
    """A chunk without CRC that says that it unpacks to so many bytes."""
    return record_of(6, struct.pack("<QQQI", 0, 0, says, 0) + text(packing) + struct.pack("<Q", len(data)) + data)


def packed(data: bytes, *, says: int | None = None) -> bytes:
    return chunk(zstandard.compress(data), says=len(data) if says is None else says)


def mcap(*records: bytes, session: Session | None = None) -> bytes:
    """An MCAP file, with the session of a recording."""
    content = "" if session is None else session.model_dump_json()
    metadata = {"format": str(FORMAT), "session": content, "sha256": sha256(content.encode()).hexdigest()}
    pairs = b"".join(text(key.encode()) + text(value.encode()) for key, value in metadata.items())
    head = record_of(1, text(b"ros2") + text(b""))
    return MAGIC + head + record_of(12, text(METADATA.encode()) + text(pairs)) + b"".join(records) + MAGIC


def zeros(size: int) -> bytes:
    """So many zeros, packed without ever being in memory."""
    packer = zstandard.ZstdCompressor().compressobj(size=size)
    return b"".join(packer.compress(bytes(2**24)) for _ in range(size // 2**24)) + packer.flush()


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("hostile") / "run.mcap"
    record(path, seconds=0.1)
    return path.read_bytes()


@pytest.fixture(scope="module")
def session(content: bytes, tmp_path_factory: pytest.TempPathFactory) -> Session:
    path = tmp_path_factory.mktemp("session") / "run.mcap"
    path.write_bytes(content)
    return read_recording(path).session


LONG = (2**63, 2**64 - 1, 51)


@pytest.mark.parametrize("length", LONG)
def test_a_length_that_no_record_has_is_damage(length: int, session: Session, tmp_path: Path) -> None:
    long = struct.pack("<BQ", 5, length) + bytes(50)
    inside = (chunk(long, says=len(long), packing=b""), packed(long), long, packed(bytes(50), says=length))
    for number, damaged in enumerate(inside):
        path = tmp_path / f"{number}.mcap"
        path.write_bytes(mcap(damaged, session=session))
        assert read_recording(path).damage.startswith("it ends early"), number
        with refuses(InputError, found="/tick"):
            _ = read_recording(path).cycles


@pytest.mark.parametrize("says", [4 * GIB, 1000, 0], ids=["big", "lies", "empty"])
def test_a_packed_file_is_never_unpacked_beyond_its_limit(says: int, session: Session, tmp_path: Path) -> None:
    """Some kilobytes that unpack to gigabytes: of nothing, or of messages of a channel without a layout."""
    path, size = tmp_path / "bomb.mcap", min(max(says, 2**28), 2**30)
    path.write_bytes(mcap(chunk(zeros(size), says=says), session=session))
    assert path.stat().st_size < 2**20
    tracemalloc.start()
    try:
        assert read_recording(path).damage.startswith("it ends early")
        assert tracemalloc.get_traced_memory()[1] < 2**27
    finally:
        tracemalloc.stop()


def test_all_chunks_count_together(session: Session, tmp_path: Path) -> None:
    path = tmp_path / "many.mcap"
    path.write_bytes(mcap(packed(record_of(3, bytes(2**26 - 9))) * 17, session=session))
    shows(read_recording(path).damage, GIB)


def test_no_more_records_are_read_than_a_run_of_hours_has(
    content: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("retarget.recording.reading.MOST_RECORDS", 50)
    path = tmp_path / "run.mcap"
    path.write_bytes(content)
    assert "50" in read_recording(path).damage


def npy(header: bytes, data: bytes = b"") -> bytes:
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + data


HEADERS = {
    "no closing brace": b"{'descr': '<f8', 'fortran_order': False, 'shape': (3,), ",
    "more than there is": b"{'descr': '<f8', 'fortran_order': False, 'shape': (3000000000,), }",
    "wide texts": b"{'descr': '<U300000000', 'fortran_order': False, 'shape': (300000,), }",
    "texts of no width": b"{'descr': '<U0', 'fortran_order': False, 'shape': (3000000000,), }",
    "a negative size": b"{'descr': '<f8', 'fortran_order': False, 'shape': (-3,), }",
    "a number of many digits": b"{'descr': '<f8', 'fortran_order': False, 'shape': (" + b"9" * 5000 + b",), }",
    "no repeats": b"{'descr': ',f8', 'fortran_order': False, 'shape': (3,), }",
    "deep": b"(" * 9000,
    "objects": b"{'descr': '|O', 'fortran_order': False, 'shape': (3,), }",
}


@pytest.mark.parametrize("header", HEADERS.values(), ids=HEADERS)
def test_a_header_that_cannot_be_is_refused(header: bytes, tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    with zipfile.ZipFile(path, "w") as archive:
        for key in sorted(ROBOT_KEYS):
            archive.writestr(f"{key}.npy", npy(header, bytes(24)))
    with refuses(InputError, "numpy.asarray" if header == HEADERS["objects"] else "damaged"):
        read_run.read_run(path)


def test_arrays_are_refused_by_what_they_unpack_to(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    with zipfile.ZipFile(path, "w") as archive:
        for key in sorted(ROBOT_KEYS):
            archive.writestr(f"{key}.npy", npy(b"{'descr': '<f8', 'fortran_order': False, 'shape': (3,), }", bytes(24)))
            archive.filelist[-1].file_size = GIB // 4
    with refuses(InputError, "too large"):
        read_run.read_run(path)


@pytest.mark.parametrize("name", ["run.mcap", "run.npz"])
def test_a_pipe_is_refused_and_not_waited_for(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    os.mkfifo(path)
    for read in (read_recording, read_run.read_run, open_recorded):
        with refuses(InputError):
            read(path)
