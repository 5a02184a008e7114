"""Recording what arrives: the tick never waits, and a disk that fails ends the recording only."""

import threading
from pathlib import Path

import pytest

from retarget.live import raw_tap
from retarget.live.datagram import Datagram
from retarget.live.raw_tap import RawTap
from retarget.sources.raw_record import MAX_UNWRITTEN, RawReader, RawWriter

PATIENCE_S = 5.0


def datagram(number: int, size: int = 10) -> Datagram:
    return Datagram(100.0 + number * 0.01, ("192.168.1.20", 5000 + number % 10), bytes([number % 256]) * size)


class HeldWriter(RawWriter):
    """A writer on a disk that does not answer until it is told to; `reached` when somebody waits for it."""

    def __init__(self, path: Path) -> None:
        self.answers = threading.Event()
        self.answers.set()
        self.reached = threading.Event()
        super().__init__(path, url="vmc://")

    def flush(self) -> None:
        self.reached.set()
        assert self.answers.wait(PATIENCE_S)
        super().flush()


def test_what_is_taken_is_in_the_file_once_it_is_closed(tmp_path: Path) -> None:
    path = tmp_path / "a.raw"
    with RawTap(RawWriter(path, url="vmc://:39539")) as tap:
        for number in range(500):
            tap.take(datagram(number))
    tap.close()
    reader = RawReader(path)
    found = list(reader)
    assert reader.url == "vmc://:39539" and (tap.lost, tap.trouble) == (0, "")
    assert [row.payload for row in found] == [datagram(number).payload for number in range(500)]
    assert [row.time_s for row in found] == pytest.approx([100.0 + number * 0.01 for number in range(500)], abs=1e-9)
    assert {(row.address, row.port) for row in found} == {("192.168.1.20", 5000 + port) for port in range(10)}


def test_it_is_written_while_the_run_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(raw_tap, "FLUSH_S", 0.001)
    writer = HeldWriter(tmp_path / "a.raw")
    with RawTap(writer) as tap:
        tap.take(datagram(1))
        for _ in range(2):
            writer.reached.clear()
            assert writer.reached.wait(PATIENCE_S), "nobody writes"
        assert len(list(RawReader(tmp_path / "a.raw"))) == 1


def test_a_disk_that_hangs_holds_nobody_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(raw_tap, "FLUSH_S", 0.001)
    monkeypatch.setattr(raw_tap, "PATIENCE_S", 0.01)
    writer = HeldWriter(tmp_path / "a.raw")
    writer.answers.clear()
    writer.reached.clear()  # before the thread begins: it waits in its first flush
    tap = RawTap(writer)
    assert writer.reached.wait(PATIENCE_S)
    for number in range(100):
        tap.take(datagram(number, size=60_000))
    assert tap.lost >= 100 - MAX_UNWRITTEN // 60_000
    tap.close()
    assert tap.trouble == "the disk does not answer"
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
    assert tap.trouble == "No space left on device"
    before = tap.lost
    tap.take(datagram(2))
    assert tap.lost == before + 1
