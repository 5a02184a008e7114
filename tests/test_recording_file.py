"""A recording as a file: what is flushed is whole on the disk, and nothing that is there is touched."""

from pathlib import Path
from typing import IO

import pytest
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from recordings import record
from retarget.errors import UsageError
from retarget.recording.cdr import CdrBuilder
from retarget.recording.events import Event, Level, log_message
from retarget.recording.file import METADATA, RecordingFile, _Direct
from retarget.recording.reading import read_recording
from retarget.recording.session import ConfigFile, Session
from retarget.recording.topics import EVENTS, Topic
from support.messages import refuses

CONFIG = ConfigFile(name="robot.yaml", path="robot.yaml", sha256="0")
EVENT = log_message(Event(0.0, 1, Level.INFO, "run", "x" * 500), stamp_ns=5)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    return record(tmp_path_factory.mktemp("file") / "run.mcap", seconds=0.05).played().recording.session


def new(path: Path, session: Session, *configs: tuple[ConfigFile, bytes]) -> RecordingFile:
    file = RecordingFile(path, session, configs)
    file.announce([])
    return file


def test_it_is_found_again(session: Session, tmp_path: Path) -> None:
    file = new(tmp_path / "a.mcap", session, (CONFIG, b"name: op3"))
    file.add(EVENTS, index=7, stamp_ns=5, data=EVENT)
    file.finish()
    with (tmp_path / "a.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        (metadata,) = reader.iter_metadata()
        assert metadata.name == METADATA and set(metadata.metadata) == {"format", "session", "sha256"}
        (attached,) = reader.iter_attachments()
        assert (attached.name, attached.data) == ("robot.yaml", b"name: op3")
        ((_, channel, message),) = reader.iter_messages()
        assert (channel.topic, message.sequence, message.log_time, message.data) == (EVENTS, 7, 5, EVENT)
    assert read_recording(tmp_path / "a.mcap").session == session
    assert file.size == (tmp_path / "a.mcap").stat().st_size


def test_names_can_be_told_apart_whatever_is_in_them(session: Session, tmp_path: Path) -> None:
    file = RecordingFile(tmp_path / "a.mcap", session, ())
    layout, names = CdrBuilder().header("").sequence("q", "float32", 3).build(), ("left knee", "neck", "a\tb ")
    every = lambda cycles: cycles.kept  # noqa: E731
    file.announce([Topic("/x", "retarget_msgs/msg/Posture", names, layout, every, lambda rows, cycles: None)])
    file.add("/x", index=0, stamp_ns=0, data=layout.template)
    file.finish()
    with (tmp_path / "a.mcap").open("rb") as stream:
        (found,) = make_reader(stream).iter_messages(topics=["/x"])
    assert found[1].metadata["names"].split() == ["left_knee", "neck", "a_b"]


def test_what_is_flushed_is_whole_and_what_is_not_is_lost(session: Session, tmp_path: Path) -> None:
    file = new(tmp_path / "a.mcap", session)
    for index in range(3):
        file.add(EVENTS, index=index, stamp_ns=index, data=EVENT)
        if index < 2:
            file.flush()
    file.close()
    with (tmp_path / "a.mcap").open("rb") as stream:
        records = StreamReader(stream, validate_crcs=True).records
        found = [next(records) for _ in range(100) if stream.tell() < file.size]
    assert sum(type(one).__name__ == "Message" for one in found) == 2


def test_a_file_that_is_there_is_not_touched(session: Session, tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"mine")
    with refuses(UsageError):
        new(tmp_path / "a.mcap", session)
    assert (tmp_path / "a.mcap").read_bytes() == b"mine"
    with refuses(UsageError):
        new(tmp_path / "no" / "a.mcap", session)


def test_what_is_discarded_is_gone(session: Session, tmp_path: Path) -> None:
    file = new(tmp_path / "a.mcap", session)
    file.discard()
    file.close()
    assert list(tmp_path.iterdir()) == []


def test_a_config_file_that_is_too_large_is_left_out(
    session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("retarget.recording.file.LARGEST", 10)
    file = new(tmp_path / "a.mcap", session, (CONFIG, b"12345678901"), (CONFIG, b"1234567890"))
    file.finish()
    with (tmp_path / "a.mcap").open("rb") as stream:
        assert [one.data for one in make_reader(stream).iter_attachments()] == [b"1234567890"]


class Slow:
    """A file that takes a few bytes at a time."""

    def __init__(self, inner: IO[bytes]) -> None:
        self._inner = inner

    def write(self, data: memoryview) -> int:
        return self._inner.write(data[:3])

    def close(self) -> None:
        self._inner.close()


def test_a_disk_that_takes_little_at_a_time_gets_all_of_it(tmp_path: Path) -> None:
    stream = _Direct(tmp_path / "a")
    stream._file = Slow(stream._file)  # type: ignore[assignment]
    assert stream.write(b"0123456789") == 10 and stream.tell() == 10
    stream.close()
    assert (tmp_path / "a").read_bytes() == b"0123456789"


def test_a_disk_that_takes_nothing_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stream = _Direct(tmp_path / "a")
    monkeypatch.setattr(Slow, "write", lambda self, data: 0)
    stream._file = Slow(stream._file)  # type: ignore[assignment]
    with refuses(OSError, "Input/output"):
        stream.write(b"0")
