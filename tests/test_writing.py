"""The thread that writes: all that was finished, in the order of time; what goes wrong is said and never raised."""

import errno
from pathlib import Path

import numpy as np
import pytest

from recordings import record
from retarget.recording.cycles import Cycles, Shape
from retarget.recording.events import Event, Events, Level
from retarget.recording.file import RecordingFile
from retarget.recording.reading import read_recording
from retarget.recording.ring import Ring
from retarget.recording.session import Session
from retarget.recording.topics import TICK, Topic, topics
from retarget.recording.writing import WritingThread

SHAPE = Shape(sensors=1, servos=0, rest=0, human=3, joints=1, landmarks=0, observers=0, human_observers=0)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    return record(tmp_path_factory.mktemp("writing") / "run.mcap", seconds=0.05).played().recording.session


@pytest.fixture
def made() -> list[Topic]:
    return topics(SHAPE, sensors=("head",), human_joints=("a",), landmarks=(), dt=0.01, robot=None)


class Begun:
    """A ring, events and the thread that takes them; not started."""

    def __init__(self, path: Path, session: Session, made: list[Topic]) -> None:
        self.ring, self.events = Ring(SHAPE, rows=64), Events()
        self.file = RecordingFile(path, session, [])
        self.file.announce(made)
        self.thread = WritingThread(self.file, self.ring, self.events, made, lambda time: round(time * 1e9))

    def fill(self, count: int) -> None:
        rows: Cycles = self.ring.rows
        for _ in range(count):
            rows.time[self.ring.at] = 0.01 * self.ring.index
            self.ring.turn()


def test_all_that_was_finished_is_in_the_file_in_order(tmp_path: Path, session: Session, made: list[Topic]) -> None:
    begun = Begun(tmp_path / "a.mcap", session, made)
    begun.fill(40)
    begun.events.add(Event(0.105, 10, Level.INFO, "run", "hello"))
    begun.thread.start()
    begun.thread.close()
    begun.thread.close()
    recording = read_recording(tmp_path / "a.mcap")
    assert begun.thread.trouble == "" and begun.thread.written == 40 and begun.thread.cpu_s > 0.0
    assert recording.damage == "" and recording.topic(TICK).cycles.tolist() == list(range(40))
    assert recording.texts == {(10, "run"): "hello"}
    assert recording.topic(TICK).rows["stamp.nanosec"].tolist() == [10_000_000 * number for number in range(40)]


@pytest.mark.parametrize(
    ("error", "told"),
    [(OSError(errno.ENOSPC, "No space left on device"), "No space left on device"), (KeyError("x"), "KeyError: 'x'")],
)
def test_what_goes_wrong_is_said_and_frees_whoever_waits(
    error: Exception, told: str, tmp_path: Path, session: Session, made: list[Topic], monkeypatch: pytest.MonkeyPatch
) -> None:
    begun = Begun(tmp_path / "a.mcap", session, made)

    def fails(self: RecordingFile) -> None:
        raise error

    monkeypatch.setattr(RecordingFile, "flush", fails)
    begun.fill(3)
    begun.thread.start()
    begun.thread.close()
    assert begun.thread.trouble == told and begun.thread.written == 0
    begun.ring._patient = True
    begun.fill(200)  # would wait for ever if somebody were still expected
    assert begun.ring.lost > 0


def test_what_is_not_a_number_is_kept(tmp_path: Path, session: Session, made: list[Topic]) -> None:
    begun = Begun(tmp_path / "a.mcap", session, made)
    begun.ring.rows.human_q[:], begun.ring.rows.kept[:] = np.nan, True
    begun.fill(2)
    begun.thread.start()
    begun.thread.close()
    assert begun.thread.trouble == "" and read_recording(tmp_path / "a.mcap").damage == ""
