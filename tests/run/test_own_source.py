"""A live source of one's own: asked in the ticks, followed as any other, and never able to hang or hide a mistake."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware.clock import Clock, VirtualClock
from messages import refuses
from retarget.errors import InputError
from retarget.live.admission import MOST_PER_POLL
from retarget.live.begin import LiveOptions
from retarget.live.raw_recording import RawTap
from retarget.model.robot import RobotBody
from retarget.run.options import RunOptions
from retarget.run.own_source import MOST_WAITING, OwnSource, Read, performing, written
from retarget.run.prepare import prepare_for
from retarget.run.run_result import RunResult
from retarget.sources.streams.json_pose import JsonPoseDecoder
from retarget.sources.streams.raw_record import RawReader, RawWriter
from retarget.sources.streams.stream_frame import StreamFrame
from sim.mock_bus import MockBus, mock_bus
from sim.performer import synthetic_performer

STILL_S = 2.0
PERSON = synthetic_performer()


def frame_at(seconds: float, chance: np.random.Generator) -> StreamFrame:
    seen = PERSON.sample(float(np.clip(seconds - STILL_S, 0.0, PERSON.duration_s)))
    noisy = seen.position + chance.normal(0.0, 5e-4, seen.position.shape)
    return StreamFrame(seen.names, noisy, seen.orientation, seen.valid, stamp=seconds)


def run(read: Read, clock: VirtualClock, buses: list[MockBus], tap: RawTap | None = None) -> RunResult:
    """A run until the source is over. buses: gets the one that it had."""

    def bus(robot: RobotBody, clock: Clock) -> MockBus:
        buses.append(mock_bus(robot, clock))
        return buses[0]

    performer = performing(read, LiveOptions(countdown=0.2, patience=2.0), clock=clock, tap=tap)
    with prepare_for(performer, RunOptions(robot="op3"), clock=clock, make_bus=bus, goes_to_rest=True) as prepared:
        return prepared.run()


@given(st.integers(0, 2**32 - 1), st.sampled_from([None, 12.25]), st.sampled_from([None, 7]))
def test_what_is_written_is_read_back(seed: int, stamp: float | None, number: int | None) -> None:
    chance = np.random.default_rng(seed)
    names = ("head", "l_wrist", "r_wrist", "tail")
    position, orientation = chance.normal(size=(4, 3)), chance.normal(size=(4, 4))
    orientation /= np.linalg.norm(orientation, axis=1, keepdims=True)
    position[1], orientation[2] = np.nan, np.nan
    tracked = chance.random(4) < 0.5
    frame = StreamFrame(names, position, orientation, tracked, stamp=stamp, number=number)
    (read,) = JsonPoseDecoder().decode(written(frame))
    assert (read.names, read.stamp, read.number) == (names, stamp, number)
    np.testing.assert_array_equal(read.position, position)
    np.testing.assert_allclose(read.orientation, orientation, atol=1e-15)
    np.testing.assert_array_equal(read.tracked, tracked)


def test_polls_are_bounded_and_what_is_too_much_is_counted() -> None:
    said = [[frame_at(0.0, np.random.default_rng(0))] * (MOST_WAITING + 5)]
    source = OwnSource(lambda now: said.pop() if said else None)
    taken = [len(source.poll(0.0))]
    assert taken == [MOST_PER_POLL]
    while not source.finished:
        taken.append(len(source.poll(float(len(taken)))))
    assert max(taken) == MOST_PER_POLL and sum(taken) == MOST_WAITING
    assert source.dropped.reasons == {"more frames than are taken": 5}


def test_the_function_is_not_called_after_the_end() -> None:
    asked: list[float] = []

    def read(now: float) -> Sequence[StreamFrame] | None:
        asked.append(now)
        return None

    source = OwnSource(read)
    assert source.poll(1.0) == [] and source.finished and source.poll(2.0) == []
    other = OwnSource(read)
    other.close()
    assert other.finished and other.poll(3.0) == [] and asked == [1.0]


@pytest.mark.long
def test_the_performer_is_followed_until_the_source_is_over_and_can_be_recorded(tmp_path: Path) -> None:
    chance, clip, buses = np.random.default_rng(0), list[StreamFrame](), list[MockBus]()
    begun: list[float] = []

    def read(now: float) -> list[StreamFrame] | None:
        begun[:] = begun or [now]
        clip.append(frame_at(now - begun[0], chance))
        return None if now - begun[0] > 6.5 else clip[-1:]

    path = tmp_path / "own.raw"
    with RawTap(RawWriter(path, url="json://:14150")) as tap:
        result = run(read, VirtualClock(), buses, tap)
    assert result.ticks_followed > 100 and result.stop is None and not buses[0].torque_on
    kept = [row.payload for row in RawReader(path)]
    assert kept and kept == [written(frame) for frame in clip[: len(kept)]]


@pytest.mark.long
def test_an_exception_of_the_function_ends_the_run_at_rest_and_is_its_reason() -> None:
    chance, clock, buses = np.random.default_rng(0), VirtualClock(), list[MockBus]()
    begun: list[float] = []

    def read(now: float) -> list[StreamFrame]:
        begun[:] = begun or [now]
        if now - begun[0] > 6.0:
            assert buses[0].torque_on
            raise KeyError("l_wrsit")
        return [frame_at(now - begun[0], chance)]

    result = run(read, clock, buses)
    assert result.reason == "KeyError: 'l_wrsit'" and not buses[0].torque_on


def test_a_source_without_frames_is_refused() -> None:
    with refuses(InputError, 2):
        run(lambda now: [], VirtualClock(), [])
