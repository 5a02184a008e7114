"""A recording as cycles: in order, each once; what is missing is counted, and what cannot be is refused."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from recordings import Recorded, record
from retarget.errors import InputError
from retarget.recording.cycles import Done
from retarget.recording.played import played
from retarget.recording.reading import Recording, TopicRows
from retarget.recording.topics import GOALS, SENSORS, SERVOS, TICK


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


@pytest.mark.parametrize(
    ("change", "message"), [(shifted, "do not begin where a run begins"), (nobody, "nobody is there")]
)
def test_what_is_no_run_is_refused(change: Callable[[TopicRows], TopicRows], message: str, run: Recorded) -> None:
    with pytest.raises(InputError, match=message):
        played(changed(run.played().recording, TICK, change))


@pytest.mark.parametrize("topic", [TICK, SERVOS, SENSORS])
def test_a_topic_that_is_missing_is_named(topic: str, run: Recorded) -> None:
    recording = run.played().recording
    topics = {name: rows for name, rows in recording.topics.items() if name != topic}
    with pytest.raises(InputError, match=f"lacks a topic; found no {topic}"):
        played(replace(recording, topics=topics))
