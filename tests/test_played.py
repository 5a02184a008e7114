"""A recording as cycles: in order, each once; what is missing is counted, and what cannot be is refused."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from recordings import Recorded, record
from retarget.errors import InputError
from retarget.exporting import mcap_reader
from retarget.recording.cycles import Done
from retarget.recording.played import played
from retarget.recording.reading import Recording, TopicRows
from retarget.recording.topics import GOALS, HUMAN_POSTURE, LANDMARKS, SENSORS, SERVOS, TICK
from retarget.viewer import from_mcap
from support.messages import refuses


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("played") / "run.mcap", seconds=0.1)


def changed(recording: Recording, topic: str, change: Callable[[TopicRows], TopicRows]) -> Recording:
    return replace(recording, topics={**recording.topics, topic: change(recording.topics[topic])})


def chosen(rows: TopicRows, at: NDArray[np.intp]) -> TopicRows:
    return TopicRows(rows.cycles[at], rows.rows[at])


def test_all_of_it(run: Recorded) -> None:
    found = run.played()
    assert found.whole and found.missing == 0 and found.last_tick == run.result.ticks_followed - 1
    assert found.cycles.index.tolist() == list(range(len(found.cycles)))


def test_cycles_that_were_lost_are_counted(run: Recorded) -> None:
    whole = run.played()

    def without(rows: TopicRows) -> TopicRows:
        return chosen(rows, np.delete(np.arange(len(rows.rows)), [20, 21, 22]))

    found = played(changed(whole.recording, TICK, without))
    assert found.missing == 3 and not found.whole and len(found.cycles) == len(whole.cycles) - 3
    np.testing.assert_array_equal(found.cycles.goal[20:], whole.cycles.goal[23:])
    np.testing.assert_array_equal(found.cycles.position[20:], whole.cycles.position[23:])


def test_order_and_copies_in_the_file_do_not_matter(run: Recorded) -> None:
    whole = run.played()

    def shuffled(rows: TopicRows) -> TopicRows:
        order = np.random.default_rng(3).permutation(len(rows.rows))
        return chosen(rows, np.concatenate([order, order[:5]]))

    recording = whole.recording
    for topic in (TICK, SERVOS, GOALS, SENSORS):
        recording = changed(recording, topic, shuffled)
    found = played(recording)
    for name in ("index", "goal", "position", "q", "sensor_position", "clock"):
        np.testing.assert_array_equal(getattr(found.cycles, name), getattr(whole.cycles, name), err_msg=name)


def test_where_the_sensors_were_not_kept_nobody_was_followed(run: Recorded) -> None:
    found = played(changed(run.played().recording, SENSORS, lambda rows: chosen(rows, np.arange(10))))
    assert np.count_nonzero(found.cycles.sampled == Done.WELL) == 10 < np.count_nonzero(found.cycles.sampled)


def shifted(rows: TopicRows) -> TopicRows:
    other = rows.rows.copy()
    other["cycle"] += 1
    return TopicRows(rows.cycles, other)


def nobody(rows: TopicRows) -> TopicRows:
    other = rows.rows.copy()
    other["sampled"][0] = Done.FAILED
    return TopicRows(rows.cycles, other)


@pytest.mark.parametrize("change", [shifted, nobody])
def test_what_is_no_run_is_refused(change: Callable[[TopicRows], TopicRows], run: Recorded) -> None:
    with refuses(InputError):
        played(changed(run.played().recording, TICK, change))


@pytest.mark.parametrize("topic", [TICK, SERVOS, SENSORS])
def test_a_topic_that_is_missing_is_named(topic: str, run: Recorded) -> None:
    recording = run.played().recording
    topics = {name: rows for name, rows in recording.topics.items() if name != topic}
    with refuses(InputError, found=topic):
        played(replace(recording, topics=topics))


def test_a_first_tick_that_lost_its_sensors_is_refused(run: Recorded) -> None:
    with refuses(InputError):
        played(changed(run.played().recording, SENSORS, lambda rows: chosen(rows, np.arange(1))))


def test_more_ticks_than_there_can_be_are_refused(run: Recorded) -> None:
    recording = run.played().recording
    with refuses(InputError):
        played(replace(recording, session=recording.session.model_copy(update={"ticks": 1})))


def renamed(topic: str, field: str, recording: Recording) -> Recording:
    """The same bytes, in which a field has another name."""

    def other(rows: TopicRows) -> TopicRows:
        kind, names = rows.rows.dtype, rows.rows.dtype.names or ()
        fields: Mapping[str, Any] = kind.fields or {}
        told = {
            "names": [f"no_{name}" if name == field else name for name in names],
            "formats": [fields[name][0] for name in names],
            "offsets": [fields[name][1] for name in names],
            "itemsize": kind.itemsize,
        }
        return TopicRows(rows.cycles, rows.rows.view(np.dtype(told)))  # type: ignore[call-overload]

    return changed(recording, topic, other)


@pytest.mark.parametrize(
    ("topic", "field", "shown", "exported"),
    [
        (TICK, "root", False, False),
        (TICK, "observer_modes", False, True),
        (HUMAN_POSTURE, "q", False, True),
        (LANDMARKS, "poses", False, False),
    ],
)
def test_a_field_that_is_missing_is_one_message_to_whoever_reads_it(
    topic: str, field: str, shown: bool, exported: bool, run: Recorded, monkeypatch: pytest.MonkeyPatch
) -> None:
    less = renamed(topic, field, run.played().recording)
    for module in (from_mcap, mcap_reader):
        monkeypatch.setattr(module, "read_recording", lambda path: less)
    for fine, read in ((shown, from_mcap.open_viewed), (exported, mcap_reader.read_mcap_run)):
        if fine:
            read(run.path)
        else:
            with refuses(InputError):
                read(run.path)


def test_a_human_whose_postures_have_no_order_is_exported_as_far_as_it_goes(
    run: Recorded, monkeypatch: pytest.MonkeyPatch
) -> None:
    still = changed(run.played().recording, HUMAN_POSTURE, lambda rows: TopicRows(rows.cycles * 0 + 20, rows.rows))
    monkeypatch.setattr(mcap_reader, "read_recording", lambda path: still)
    assert len(mcap_reader.read_mcap_human(run.path)) == 1
