"""Recording what arrives: the tick never waits, and a disk that fails ends the recording only."""

import gzip
import json
import struct
import threading
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hardware.clock import VirtualClock
from messages import refuses
from retarget.errors import InputError, UsageError
from retarget.live import open_stream, raw_recording
from retarget.live.address import parse_address
from retarget.live.admission import Datagram
from retarget.live.open_stream import read_recording
from retarget.live.raw_recording import RawTap, ReplayReceiver, open_replay, recorded_kind
from retarget.sources.streams.raw_record import MAX_UNWRITTEN, RawReader, RawWriter

PATIENCE_S = 5.0


def datagram(number: int, size: int = 10) -> Datagram:
    return Datagram(100.0 + number * 0.01, ("192.168.1.20", 5000 + number % 10), bytes([number % 256]) * size)


class HeldWriter(RawWriter):
    """A writer on a disk that does not answer until `answers` is set; `reached` when the thread waits for it."""

    def __init__(self, path: Path) -> None:
        self.answers = threading.Event()
        self.answers.set()
        self.reached = threading.Event()
        super().__init__(path, url="vmc://")

    def flush(self) -> None:
        self.reached.set()
        assert self.answers.wait(PATIENCE_S)
        super().flush()


def test_every_datagram_is_in_the_file_once_it_is_closed(tmp_path: Path) -> None:
    path = tmp_path / "a.raw"
    with RawTap(RawWriter(path, url="vmc://:39539")) as tap:
        for number in range(500):
            tap.take(datagram(number))
    tap.close()
    reader = RawReader(path)
    found = list(reader)
    assert reader.url == "vmc://:39539" and (tap.lost, tap.failure) == (0, "")
    assert [row.payload for row in found] == [datagram(number).payload for number in range(500)]
    assert [row.time_s for row in found] == pytest.approx([100.0 + number * 0.01 for number in range(500)], abs=1e-9)
    assert {(row.address, row.port) for row in found} == {("192.168.1.20", 5000 + port) for port in range(10)}


def test_a_disk_that_hangs_delays_no_tick(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(raw_recording, "FLUSH_S", 0.001)
    monkeypatch.setattr(raw_recording, "DISK_WAIT_S", 0.01)
    writer = HeldWriter(tmp_path / "a.raw")
    writer.answers.clear()
    writer.reached.clear()  # before the thread begins: it waits in its first flush
    tap = RawTap(writer)
    assert writer.reached.wait(PATIENCE_S)
    for number in range(100):
        tap.take(datagram(number, size=60_000))
    assert tap.lost >= 100 - MAX_UNWRITTEN // 60_000
    tap.close()
    assert tap.failure == "the disk does not answer"
    writer.answers.set()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no disk that is always full")
def test_a_full_disk_ends_the_recording_and_nothing_else(tmp_path: Path) -> None:
    writer = RawWriter(tmp_path / "a.raw", url="vmc://")
    writer._file.close()
    with Path("/dev/full").open("wb", buffering=0) as full:
        writer._file = full
        tap = RawTap(writer)
        tap.take(datagram(1))
        tap.close()
    assert tap.failure == "No space left on device"
    before = tap.lost
    tap.take(datagram(2))
    assert tap.lost == before + 1


GAPS = st.lists(st.floats(0.0, 0.3), min_size=1, max_size=40)


def recording(path: Path, times: list[float], *, url: str = "vmc://", size: int = 2) -> Path:
    path.unlink(missing_ok=True)
    writer = RawWriter(path, url=url)
    for number, time in enumerate(times):
        writer.append(number.to_bytes(2) + bytes(size - 2), time_ns=round(time * 1e9), address="10.0.0.5", port=7)
        writer.flush()
    writer.close()
    return path


def played(receiver: ReplayReceiver, seconds: float, *, start: float = 0.0, step: float = 0.01) -> list[Datagram]:
    clock, found = VirtualClock(start), []
    while clock.now() <= start + seconds:
        found += receiver.poll(clock.now())
        clock.advance(step)
    return found


def numbers(found: list[Datagram]) -> list[int]:
    return [int.from_bytes(datagram.payload[:2]) for datagram in found]


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
@given(GAPS, st.floats(0.2, 5.0), st.floats(0.001, 0.5))
def test_nothing_comes_early_or_twice_or_not_at_all(
    tmp_path: Path, gaps: list[float], speed: float, step: float
) -> None:
    times = [5.0 + sum(gaps[:k]) for k in range(len(gaps))]
    receiver = ReplayReceiver(RawReader(recording(tmp_path / "a.raw", times)), speed=speed)
    clock, found = VirtualClock(9.0), list[Datagram]()
    while not receiver.finished:
        for datagram in receiver.poll(clock.now()):
            assert clock.now() - step - 1e-9 <= datagram.arrival <= clock.now()
            found.append(datagram)
        clock.advance(step)
    assert numbers(found) == list(range(len(times)))
    assert receiver.poll(1e9) == []


def test_an_empty_recording_ends_a_jump_back_of_its_clock_does_not_wait_and_a_damaged_end_is_counted(
    tmp_path: Path,
) -> None:
    receiver = ReplayReceiver(RawReader(recording(tmp_path / "a.raw", [])))
    assert receiver.poll(0.0) == [] and receiver.finished
    receiver = ReplayReceiver(RawReader(recording(tmp_path / "a.raw", [7200.0, 7200.1, 3600.0, 3600.1])))
    found = played(receiver, 0.25)
    assert [d.arrival for d in found] == pytest.approx([0.0, 0.1, 0.1, 0.2], abs=1e-6)
    path = recording(tmp_path / "a.raw", [1.0, 1.1, 1.2])
    path.write_bytes(path.read_bytes()[:-1])
    receiver = ReplayReceiver(RawReader(path))
    assert numbers(played(receiver, 1.0)) == [0, 1]
    assert receiver.finished and receiver.dropped.reasons == {"the recording is damaged": 1}


def test_opening_by_address(tmp_path: Path) -> None:
    path = recording(tmp_path / "a.raw", [1.0, 2.0], url="natnet://192.168.1.5")
    address = parse_address(f"replay://{path}?speed=10")
    assert recorded_kind(address) == "natnet"
    assert numbers(played(open_replay(address), 0.25)) == [0, 1]
    with refuses(InputError):
        open_replay(parse_address(f"replay://{tmp_path}/b.raw"))


def test_an_old_recording_needs_its_kind_in_the_address(tmp_path: Path) -> None:
    path = tmp_path / "old.udprec.gz"
    path.write_bytes(gzip.compress(b"UDPREC01" + struct.pack("<QHI", 10**18, 7, 2) + b"ab"))
    with refuses(InputError, "?kind=vmc"):
        recorded_kind(parse_address(f"replay://{path}"))
    address = parse_address(f"replay://{path}?kind=vmc")
    assert recorded_kind(address) == "vmc"
    assert open_replay(address).poll(3.0) == [Datagram(3.0, ("127.0.0.1", 7), b"ab")]


def test_a_recording_of_several_kinds_or_of_none_is_not(tmp_path: Path) -> None:
    mixed = [b'{"axes": "rep103", "poses": {"head": {"p": [0, 0, 1]}}}', b"/VMC/Ext/T\0\0,f\0\0\0\0\0\0"]
    for number, payloads in enumerate((mixed, [b"what is this"], [])):
        path = tmp_path / f"{number}.raw"
        writer = RawWriter(path, url="")
        for payload in payloads:
            writer.append(payload, time_ns=0, address="127.0.0.1", port=5)
        writer.close()
        with refuses(InputError):
            recorded_kind(parse_address(f"replay://{path}"))


def test_a_recording_is_read_by_the_names_of_its_sender(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = RawWriter(tmp_path / "a.raw", url="json://:14150")
    for k in range(5):
        poses = {"head": {"p": [0, 0, 1 + k]}, "hat": {"p": [0, 0, 2], "tracked": k != 2}}
        payload = json.dumps({"axes": "rep103", "time": 0.1 * k, "poses": poses}).encode()
        writer.append(payload, time_ns=10**9 + k * 10**8, address="127.0.0.1", port=5)
    writer.append(b"hello", time_ns=2 * 10**9, address="127.0.0.1", port=5)
    writer.close()
    address = parse_address(f"replay://{tmp_path}/a.raw")
    frames = read_recording(address)
    assert frames.names == ("head", "hat") and frames.rate_hz == pytest.approx(10.0)
    assert frames.position[:, 0, 2].tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert frames.valid[:, 1].tolist() == [True, True, False, True, True]
    assert frames.notes == ("not used: not JSON in UTF-8 (1)",)
    monkeypatch.setattr(open_stream, "MOST_READ", 3)
    assert read_recording(address).notes == ("only the first 2 frames were read",)
    with refuses(UsageError):
        read_recording(parse_address(f"{address.text}?up=z"))
    (tmp_path / "a.raw").write_bytes((tmp_path / "a.raw").read_bytes()[:50])
    with refuses(InputError, varies=str(tmp_path)):
        read_recording(address)
