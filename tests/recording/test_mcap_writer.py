"""Events on their way to the file: in order, bounded, and as the log message that tools show."""

import errno
import threading
from collections import deque
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from mcap.reader import make_reader

from messages import refuses
from recordings import decoded, record
from retarget.errors import UsageError
from retarget.recording.cdr import layout_of
from retarget.recording.cycles import Done
from retarget.recording.mcap_writer import (
    LogEvent,
    LogLevel,
    RecordingFile,
    Ring,
    WritingThread,
    log_message,
)
from retarget.recording.reading import _log_of, read_recording
from retarget.recording.session import ConfigFile, Session
from retarget.recording.topics import TICK, Topic, topics

LOG = "rcl_interfaces/msg/Log"


def event(text: str, *, cycle: int = 3) -> LogEvent:
    return LogEvent(1.0, cycle, LogLevel.WARN, "guard", text)


def test_any_text_can_be_kept() -> None:
    """Of any length and language; what is no Unicode does not end a recording."""
    for text, wanted in (("", ""), ("größer als 90°", "größer als 90°"), ("x" * 5000, "x" * 2000), ("a\udcff", "a?")):
        data = log_message(event(text, cycle=-1), stamp_ns=0)
        message = decoded(LOG, data)
        assert (message.msg, message.line) == (wanted, 0)
        assert _log_of(data) == ("guard", wanted)


CONFIG = ConfigFile(name="robot.yaml", path="robot.yaml", sha256="0")


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    return record(tmp_path_factory.mktemp("file") / "run.mcap", seconds=0.05).read().session


def new(path: Path, session: Session, *configs: tuple[ConfigFile, bytes]) -> RecordingFile:
    file = RecordingFile(path, session, configs)
    file.announce([])
    return file


def test_names_stay_distinct_whatever_is_in_them(session: Session, tmp_path: Path) -> None:
    file = RecordingFile(tmp_path / "a.mcap", session, ())
    layout, names = layout_of("retarget_msgs/msg/Posture", {"q": 3}), ("left knee", "neck", "a\tb ")
    every = lambda cycles: cycles.kept  # noqa: E731
    file.announce([Topic("/x", "retarget_msgs/msg/Posture", names, layout, every, lambda cycles: {})])
    file.add("/x", index=0, stamp_ns=0, data=layout.template)
    file.finish()
    with (tmp_path / "a.mcap").open("rb") as stream:
        (found,) = make_reader(stream).iter_messages(topics=["/x"])
    assert found[1].metadata["names"].split() == ["left_knee", "neck", "a_b"]


def test_a_file_that_is_there_is_not_touched(session: Session, tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"mine")
    with refuses(UsageError):
        new(tmp_path / "a.mcap", session)
    assert (tmp_path / "a.mcap").read_bytes() == b"mine"
    with refuses(UsageError):
        new(tmp_path / "no" / "a.mcap", session)


def test_a_config_file_that_is_too_large_is_left_out(
    session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("retarget.recording.mcap_writer.LARGEST", 10)
    file = new(tmp_path / "a.mcap", session, (CONFIG, b"12345678901"), (CONFIG, b"1234567890"))
    file.finish()
    with (tmp_path / "a.mcap").open("rb") as stream:
        assert [one.data for one in make_reader(stream).iter_attachments()] == [b"1234567890"]


WIDTHS = {"sensors": 2, "servos": 3, "rest": 7}


def fill(ring: Ring, count: int) -> None:
    for _ in range(count):
        ring.rows.goal_ticks[ring.at] = ring.index
        ring.rows.written[ring.at] = Done.WELL
        ring.turn()


def test_rows_come_out_in_order_and_once() -> None:
    ring = Ring(WIDTHS, rows=8)
    seen: list[int] = []
    for count in (3, 0, 5, 7, 1, 6):
        fill(ring, count)
        taken = ring.take()
        assert len(taken) == count
        np.testing.assert_array_equal(taken.goal_ticks[:, 0], taken.index)
        seen += taken.index.tolist()
    assert seen == list(range(22)) and ring.lost == 0


def test_what_there_is_no_room_for_is_counted_and_missing() -> None:
    ring = Ring(WIDTHS, rows=8)
    fill(ring, 20)
    assert ring.take().index.tolist() == list(range(7)) and ring.lost == 13
    fill(ring, 2)
    assert ring.take().index.tolist() == [20, 21]


def test_a_new_row_is_as_if_nothing_had_happened() -> None:
    ring = Ring(WIDTHS, rows=4)
    for _ in range(9):
        ring.rows.kept[ring.at], ring.rows.read[ring.at] = True, Done.FAILED
        ring.rows.asked[ring.at] = 63
        ring.turn()
        ring.take()
        at = ring.at
        assert not ring.rows.kept[at] and ring.rows.read[at] == ring.rows.asked[at] == 0


def test_who_may_wait_loses_nothing() -> None:
    ring = Ring(WIDTHS, patient=True, rows=8)
    seen: list[int] = []

    def takes() -> None:
        while len(seen) < 500:
            ring.due.wait(5.0)
            ring.due.clear()
            seen.extend(ring.take().index.tolist())

    taker = threading.Thread(target=takes, daemon=True)
    taker.start()
    fill(ring, 500)
    ring.due.set()
    taker.join(10.0)
    assert seen == list(range(500)) and ring.lost == 0


FEW_WIDTHS = {"sensors": 1, "human": 3, "joints": 1}


class Begun:
    """A ring, events and the thread that takes them; not started."""

    def __init__(self, path: Path, session: Session) -> None:
        made = topics(FEW_WIDTHS, {"sensors": ("head",), "joints": ("a",)}, dt=0.01, robot=None)
        self.ring, self.events = Ring(FEW_WIDTHS, rows=64), deque[LogEvent]()
        file = RecordingFile(path, session, [])
        file.announce(made)
        self.thread = WritingThread(file, self.ring, self.events, made, lambda time: round(time * 1e9))

    def fill(self, count: int) -> None:
        rows = self.ring.rows
        for _ in range(count):
            rows.time[self.ring.at] = 0.01 * self.ring.index
            self.ring.turn()


@pytest.fixture
def begun(tmp_path: Path, session: Session) -> Begun:
    return Begun(tmp_path / "a.mcap", session)


def test_all_that_was_finished_is_in_the_file_in_order(begun: Begun, tmp_path: Path) -> None:
    begun.fill(40)
    begun.events.append(LogEvent(0.105, 10, LogLevel.INFO, "run", "hello"))
    begun.thread.start()
    begun.thread.close()
    begun.thread.close()
    recording = read_recording(tmp_path / "a.mcap")
    assert begun.thread.failure == "" and begun.thread.cpu_s > 0.0
    assert recording.damage == "" and recording.topic(TICK).cycles.tolist() == list(range(40))
    assert recording.texts == {(10, "run"): "hello"}
    with (tmp_path / "a.mcap").open("rb") as stream:
        stamps = [found.log_time for *_, found in make_reader(stream).iter_messages(log_time_order=False)]
    assert stamps == sorted(stamps)
    assert recording.topic(TICK).rows["stamp.nanosec"].tolist() == [10_000_000 * number for number in range(40)]


@pytest.mark.parametrize(
    ("error", "failure"),
    [(OSError(errno.ENOSPC, "No space left on device"), "No space left on device"), (KeyError("x"), "KeyError: 'x'")],
)
def test_an_error_is_kept_and_frees_a_thread_that_waits(
    error: Exception, failure: str, begun: Begun, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RecordingFile, "flush", Mock(side_effect=error))
    begun.fill(3)
    begun.thread.start()
    begun.thread.close()
    assert begun.thread.failure == failure
    begun.ring._patient = True
    begun.fill(200)  # would wait for ever if the writing thread were still expected
    assert begun.ring.lost > 0
