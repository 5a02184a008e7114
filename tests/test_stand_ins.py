"""What stands in for clock, servos and performer in a replay: each says what it said then, in its cycle."""

from dataclasses import replace

import numpy as np
import pytest

from hardware.bus import ServoGoals
from hardware.errors import BusError
from recordings import Recorded, record
from retarget.recording.cursor import Cursor
from retarget.recording.cycles import Done
from retarget.recording.played import Played
from retarget.recording.stand_ins import ReplayedBus, ReplayedClock, ReplayedSamples
from support.messages import refuses


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("stand_ins") / "run.mcap", seconds=0.1)


@pytest.fixture
def found(run: Recorded) -> Played:
    return run.played()


def cursor(found: Played) -> Cursor:
    return Cursor(found.cycles, has_robot=True, dt=found.recording.session.dt)


def test_the_clock_reads_what_it_read(found: Played) -> None:
    at = cursor(found)
    clock, cycles = ReplayedClock(at), found.cycles
    for cycle in range(5):
        at.look()
        readings = int(cycles.readings[cycle])
        assert [clock.now() for _ in range(readings)] == cycles.clock[cycle, :readings].tolist()
        assert clock.now() == cycles.clock[cycle, readings - 1], "what was not read stands still"
        clock.sleep_until(1e9)


def test_the_clock_never_goes_back(found: Played) -> None:
    cycles = found.cycles.taken(np.arange(len(found.cycles)))
    cycles.clock[3] -= 1.0
    at = cursor(replace(found, cycles=cycles))
    clock, last = ReplayedClock(at), -np.inf
    for _ in range(8):
        at.look()
        now = clock.now()
        assert now >= last
        last = now
        at.before()


def test_servos_that_are_sent_the_same_are_where_they_were(found: Played) -> None:
    at = cursor(found)
    bus, cycles = ReplayedBus(found, at), found.cycles
    bus.open()
    for cycle in range(20):
        states = bus.read()
        np.testing.assert_array_equal(states.position, cycles.position[cycle])
        np.testing.assert_array_equal(states.temperature, cycles.temperature[cycle])
        if cycles.written[cycle] != Done.NOT:
            bus.write(ServoGoals(cycles.goal[cycle]))
        at.before()
    assert [row for row, _ in bus.sent] == np.flatnonzero(cycles.written[:20] != Done.NOT).tolist()
    bus.torque(True)
    bus.close()


def test_servos_that_are_sent_something_else_are_as_far_from_it(found: Played) -> None:
    at = cursor(found)
    bus, cycles = ReplayedBus(found, at), found.cycles
    for cycle in range(20):
        states = bus.read()
        if cycle > 1:
            np.testing.assert_array_equal(states.position, cycles.position[cycle] + 7)
        if cycles.written[cycle] != Done.NOT:
            bus.write(ServoGoals(cycles.goal[cycle] + 7))
        at.before()


def test_a_bus_that_failed_fails_again_in_its_words(found: Played) -> None:
    cycles = found.cycles.taken(np.arange(len(found.cycles)))
    cycles.read[3], cycles.written[5] = Done.FAILED, Done.FAILED
    texts = {(3, "bus read"): "cable out"}
    broken = replace(found, cycles=cycles, recording=replace(found.recording, texts=texts))
    at = cursor(broken)
    bus = ReplayedBus(broken, at)
    for cycle in range(6):
        if cycle == 3:
            with refuses(BusError):
                bus.read()
        else:
            bus.read()
        if cycle == 5:
            with refuses(BusError):
                bus.write(ServoGoals(cycles.goal[cycle]))
        at.before()


def test_samples_say_what_was_followed(found: Played, run: Recorded) -> None:
    samples, frames = ReplayedSamples(found, cursor(found)), run.result.clip.frames
    assert samples.kept == len(frames) == run.result.ticks_followed and samples.ticks == found.recording.session.ticks
    first = samples.sample(0)
    assert first is not None and first.names == frames.names
    np.testing.assert_array_equal(first.position, run.result.clip.sample(0).position)
    clip = samples.recorded()
    followed = [run.result.clip.sample(tick).position for tick in range(len(frames))]
    np.testing.assert_array_equal(clip.frames.position, followed)
    np.testing.assert_array_equal(clip.frames.valid, frames.valid)


def test_a_sample_that_was_none_is_none_again(found: Played) -> None:
    cycles = found.cycles.taken(np.arange(len(found.cycles)))
    row = int(np.flatnonzero(cycles.sampled != Done.NOT)[5])
    cycles.sampled[row] = Done.FAILED
    lost = replace(found, cycles=cycles)
    samples = ReplayedSamples(lost, cursor(lost))
    assert samples.sample(int(cycles.tick[row])) is None and samples.hindrance == "as recorded"
