"""Reading a recording: whole, cut anywhere, damaged anywhere, and files that are none."""

import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import Writer
from numpy.lib.recfunctions import drop_fields
from numpy.typing import NDArray

import retarget
from messages import refuses, shows
from recordings import Recorded, record
from retarget.errors import InputError, RefusedError
from retarget.recording import read_run
from retarget.recording.cdr import schema
from retarget.recording.cycles import Done
from retarget.recording.mcap_writer import METADATA
from retarget.recording.reading import MAGIC, Recording, TopicRows, read_recording
from retarget.recording.session import FORMAT
from retarget.recording.topics import HUMAN_POSTURE, SENSORS, SERVOS, TICK
from retarget.run.options import RunOptions
from retarget.run.table import STAGES
from retarget.web.recorded import open_recorded

OURS = str(FORMAT)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("played") / "run.mcap", seconds=0.1)


def edited(recording: Recording, topic: str, edit: Callable[[NDArray[Any]], None]) -> Recording:
    """With other values in the rows of a topic."""
    rows = recording.topics[topic]
    other = rows.rows.copy()
    edit(other)
    return replace(recording, topics=recording.topics | {topic: TopicRows(rows.cycles, other)})


def without_rows(recording: Recording, topic: str, rows: list[int]) -> Recording:
    kept = recording.topics[topic]
    at = np.delete(np.arange(len(kept.rows)), rows)
    return replace(recording, topics=recording.topics | {topic: TopicRows(kept.cycles[at], kept.rows[at])})


def test_all_of_it(run: Recorded) -> None:
    found = run.read()
    assert found.whole and found.missing == 0 and found.last_tick == run.result.ticks_followed - 1
    assert found.cycles.index.tolist() == list(range(len(found.cycles)))


def test_times_of_stages_are_read_where_a_recording_has_them(run: Recorded) -> None:
    whole = run.read()
    ticks = whole.topics[TICK]
    older = TopicRows(ticks.cycles, drop_fields(ticks.rows, STAGES))
    then = replace(whole, topics=whole.topics | {TICK: older}).cycles
    now = edited(whole, TICK, lambda rows: rows.__setitem__("time_gate", np.arange(len(rows)))).cycles
    assert all(np.isnan(getattr(then, name)).all() for name in STAGES)
    np.testing.assert_array_equal(now.time_gate, np.arange(len(now)))
    np.testing.assert_array_equal(then.goal_ticks, whole.cycles.goal_ticks)


@pytest.mark.long
def test_cycles_that_were_lost_are_counted(run: Recorded) -> None:
    whole = run.read()
    found = without_rows(whole, TICK, [20, 21, 22])
    assert found.missing == 3 and not found.whole and len(found.cycles) == len(whole.cycles) - 3
    np.testing.assert_array_equal(found.cycles.goal_ticks[20:], whole.cycles.goal_ticks[23:])
    np.testing.assert_array_equal(found.cycles.position[20:], whole.cycles.position[23:])


def test_orientations_are_of_sensors_that_had_one(run: Recorded) -> None:
    def turn(rows: NDArray[Any]) -> None:
        rows["poses"][..., 3:] = (0.1, 0.2, 0.4, 0.8)

    def orient_the_head(rows: NDArray[Any]) -> None:
        rows["sensor_oriented"] = np.arange(rows["sensor_oriented"].shape[1]) == 0

    found = edited(edited(run.read(), SENSORS, turn), TICK, orient_the_head).cycles
    head, *others = np.moveaxis(found.sensor_orientation[found.sampled == Done.WELL], 1, 0)
    assert (head == (0.8, 0.1, 0.2, 0.4)).all() and np.isnan(others).all()


@pytest.mark.parametrize("topic", [TICK, SERVOS, SENSORS])
def test_a_topic_that_is_missing_is_named(topic: str, run: Recorded) -> None:
    recording = run.read()
    topics = {name: rows for name, rows in recording.topics.items() if name != topic}
    with refuses(InputError, found=topic):
        _ = replace(recording, topics=topics).cycles


def test_more_ticks_than_there_can_be_are_refused(run: Recorded) -> None:
    recording = run.read()
    with refuses(InputError):
        _ = replace(recording, session=recording.session.model_copy(update={"ticks": 1})).cycles


def test_ticks_of_a_human_alone_are_those_whose_posture_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = record(tmp_path / "run.mcap", options=RunOptions(robot="human"), seconds=0.1).path
    whole = read_recording(path)
    monkeypatch.setattr(read_run, "read_recording", lambda path: without_rows(whole, HUMAN_POSTURE, [3]))
    assert len(open_recorded(path)) == len(whole.topic(HUMAN_POSTURE).rows) - 1


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A recording of several chunks."""
    path = tmp_path_factory.mktemp("reading") / "run.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("retarget.recording.mcap_writer.FLUSH_S", 0.01)
        record(path, seconds=1.0)
    return path.read_bytes()


def chunk_ends(path: Path) -> list[tuple[int, int]]:
    """Of every chunk from the first tick on: where it ends, and how many ticks are in the file until there."""
    ends, content = [], path.read_bytes()
    with path.open("rb") as stream:
        for one in StreamReader(stream, emit_chunks=True).records:
            if isinstance(one, Chunk):
                end = content.index(one.data) + len(one.data)
                path_until = path.with_suffix(".until")
                path_until.write_bytes(content[:end])
                with suppress(InputError):  # a slow machine writes a first chunk without a tick
                    ends.append((end, len(read_recording(path_until).topic(TICK).rows)))
    return ends


def test_cut_anywhere_all_whole_chunks_are_read(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(content)
    ends = chunk_ends(path)
    whole = read_recording(path).cycles
    assert len(ends) >= 3 and ends[-1][1] == len(whole)
    assert len({count for _, count in ends}) >= len(ends) - 1  # the last chunk may have no cycle, only events
    rng = np.random.default_rng(5)
    for cut in (*rng.integers(ends[0][0], len(content) - 1, 12).tolist(), len(content) - 1):
        path.write_bytes(content[:cut])
        recording = read_recording(path)
        cycles = recording.cycles
        shows(recording.damage, varies=re.compile(r"(?<=early)[:,].*"))
        assert len(cycles) == max(count for end, count in ends if end <= cut), cut
        np.testing.assert_array_equal(cycles.goal_ticks, whole.goal_ticks[: len(cycles)])
    for cut in np.linspace(0, ends[0][0] - 1, 8).astype(int).tolist():
        path.write_bytes(content[:cut])
        with pytest.raises(InputError):
            _ = read_recording(path).cycles


def test_a_flipped_bit_never_changes_what_is_read(content: bytes, tmp_path: Path) -> None:
    """Whatever stands before it is read; what is read is what was written."""
    path = tmp_path / "run.mcap"
    path.write_bytes(content)
    whole = read_recording(path).cycles
    rng = np.random.default_rng(6)
    noticed = 0
    for place in rng.integers(len(MAGIC), len(content), 40).tolist():
        path.write_bytes(content[:place] + bytes([content[place] ^ 0x10]) + content[place + 1 :])
        try:
            recording = read_recording(path)
            cycles = recording.cycles
        except RefusedError:
            noticed += 1
            continue
        noticed += bool(recording.damage)
        rows = np.searchsorted(whole.index, cycles.index)  # a bit of a chunk's opcode hides the whole chunk
        for name in ("index", "goal_ticks", "sensor_position"):
            np.testing.assert_array_equal(getattr(cycles, name), getattr(whole, name)[rows], err_msg=name)
    assert noticed >= 10


@pytest.mark.parametrize("data", [b"", b"\x89MCAP", b"PK\x03\x04" + bytes(50), MAGIC, MAGIC + bytes(100)])
def test_what_is_no_recording_is_refused(data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(data)
    with refuses(InputError):
        read_recording(path)


def foreign(path: Path, metadata: dict[str, str] | None) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        if metadata is not None:
            writer.add_metadata(METADATA, metadata)
        writer.finish()  # type: ignore[no-untyped-call]


def test_an_mcap_file_that_is_no_recording_of_ours_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    for metadata, facts in (
        (None, ()),
        ({"session": "{}"}, ()),
        ({"format": OURS, "session": "{}"}, "SHA-256"),
        ({"format": OURS}, ()),
        ({"format": OURS, "session": "{}", "sha256": sha256(b"{}").hexdigest()}, ()),
    ):
        foreign(path, metadata)
        with refuses(InputError, facts, varies=retarget.__version__):
            read_recording(path)


@pytest.mark.parametrize(
    ("other", "session", "found"),
    [
        ("1", '{"format": 1, "version": "0.1.0"}', ("format 1", "0.1.0")),
        ("4", '{"format": 4, "version": "9.9.9"}', ("format 4", "9.9.9")),
        ("4", "{}", "format 4"),
        ("4", "[]", "format 4"),
        ("4", "no JSON", "format 4"),
        ("4", "[" * 10**6, "format 4"),
    ],
    ids=["of 0.1.0", "later", "no version", "no object", "no JSON", "too deep"],
)
def test_a_recording_of_another_format_is_refused_with_the_version_that_wrote_it(
    other: str, session: str, found: str | tuple[str, ...], tmp_path: Path
) -> None:
    path = tmp_path / "x.mcap"
    foreign(path, {"format": other, "session": session, "sha256": sha256(session.encode()).hexdigest()})
    allowed = (f"format {OURS}", retarget.__version__)
    with refuses(InputError, where=path, found=found, allowed=allowed, varies=retarget.__version__):
        read_recording(path)


@pytest.mark.parametrize(
    ("field", "row", "value"),
    [
        ("cycle", slice(None), None),
        ("sampled", 0, Done.FAILED),
        ("tick", 5, 2**31 - 1),
        ("tick", 5, -1),
        ("cycle", 0, 7),
        ("cycle", -1, 2**32 - 1),
    ],
)
def test_ticks_that_cannot_be_are_refused(field: str, row: Any, value: int | None, run: Recorded) -> None:
    """None: each is one more than it was."""

    def edit(rows: NDArray[Any]) -> None:
        rows[field][row] = rows[field][row] + 1 if value is None else value

    with refuses(InputError):
        _ = edited(run.read(), TICK, edit).cycles


def test_the_message_of_a_tick_has_the_times_of_all_stages() -> None:
    lines = schema("retarget_msgs/msg/Tick").splitlines()
    assert {f"float64 {stage}" for stage in STAGES} <= set(lines)
