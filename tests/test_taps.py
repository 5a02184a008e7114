"""What stands between a run and its parts while it is recorded: the same goes through, and it is noted."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from hardware.bus import ServoGoals
from hardware.clock import VirtualClock
from hardware.errors import BusError
from retarget.frames import SensorSample
from retarget.recording.cycles import READINGS, Asked, Cycles, Done, Shape
from retarget.recording.note import Note
from retarget.recording.ring import Ring
from retarget.recording.taps import TappedBus, TappedClock, TappedSamples
from retarget.robot_body import RobotBody, load_robot
from sim.mock_bus import MockBus
from sim.mock_faults import FaultKind, MockFault


@pytest.fixture(scope="module")
def robot() -> RobotBody:
    return load_robot("op3")


@pytest.fixture
def note(robot: RobotBody) -> Note:
    shape = Shape(2, len(robot.joint_map), 0, 1, 1, 0, 0, 0)
    note = Note()
    note.begin(Ring(shape), now=0.0, dt=0.008, robot=None, guard=None)
    return note


def row(note: Note) -> Cycles:
    assert note.ring is not None
    return note.ring.rows.taken(np.array([note.ring.at]))


def bus(robot: RobotBody, note: Note, *faults: MockFault) -> TappedBus:
    start = robot.joint_map.to_ticks(robot.posture({})[robot.servo_columns])
    tapped = TappedBus(MockBus(robot.joint_map.servos, VirtualClock(), start=start, faults=faults), note)
    tapped.open()
    return tapped


def test_the_clock_is_read_as_it_is() -> None:
    clock = VirtualClock(5.0)
    assert TappedClock(clock, Note()).now() == 5.0


def test_readings_of_the_clock_are_kept_as_far_as_there_is_room(note: Note) -> None:
    clock = VirtualClock(5.0)
    tapped = TappedClock(clock, note)
    for number in range(READINGS + 3):
        assert tapped.now() == 5.0 + number
        clock.advance(1.0)
    kept = row(note)
    assert kept.readings[0] == READINGS and kept.clock[0].tolist() == [5.0 + number for number in range(READINGS)]
    assert note.now == 5.0 + READINGS + 2
    tapped.sleep_until(99.0)
    assert clock.now() == 99.0


def test_servos_and_goals_go_through_and_are_kept(robot: RobotBody, note: Note) -> None:
    tapped = bus(robot, note)
    states = tapped.read()
    tapped.write(ServoGoals(states.position + 1))
    tapped.torque(True)
    kept = row(note)
    assert (kept.read[0], kept.written[0]) == (Done.WELL, Done.WELL)
    for name in ("position", "velocity", "voltage", "temperature", "age", "valid", "driven", "alert", "error"):
        np.testing.assert_array_equal(getattr(kept, name)[0], getattr(states, name), err_msg=name)
    np.testing.assert_array_equal(kept.goal[0], states.position + 1)
    assert [event.text for event in note.events.take()] == ["torque on"]
    tapped.close()


@pytest.mark.parametrize(("kind", "what"), [(FaultKind.READ_FAILS, "read"), (FaultKind.WRITE_FAILS, "write")])
def test_what_fails_goes_through_too(kind: FaultKind, what: str, robot: RobotBody, note: Note) -> None:
    tapped = bus(robot, note, MockFault(kind, first=1, cycles=5))
    goals = ServoGoals(tapped.read().position)
    with pytest.raises(BusError):
        tapped.read()
        tapped.write(goals)
    kept = row(note)
    assert (kept.read if what == "read" else kept.written)[0] == Done.FAILED
    assert [event.who for event in note.events.take()] == [f"bus {what}"]


def samples(*said: SensorSample | None) -> Any:
    return SimpleNamespace(
        ticks=2,
        kept=2,
        dt=0.008,
        motion_dt=0.004,
        over=True,
        settled=0.25,
        hindrance="nobody",
        may_approach=lambda: True,
        listen=lambda: None,
        sample=lambda tick: said[tick],
        recorded=lambda: "all of it",
    )


def test_what_was_followed_is_kept_as_it_was_said(note: Note) -> None:
    weight = np.array([0.5, 1.0])
    said = SensorSample(("a", "b"), np.ones((2, 3)), np.full((2, 4), 0.5), np.array([True, False]), weight)
    tapped = TappedSamples(samples(None, said), note)
    assert tapped.sample(0) is None and row(note).sampled[0] == Done.FAILED
    assert tapped.sample(1) is said
    assert tapped.settled == 0.25 and tapped.over and tapped.may_approach() and tapped.hindrance == "nobody"
    kept = row(note)
    assert (kept.sampled[0], kept.tick[0], kept.settled[0]) == (Done.WELL, 1, 0.25) and kept.weighted[0]
    np.testing.assert_array_equal(kept.sensor_position[0], said.position)
    np.testing.assert_array_equal(kept.sensor_weight[0], weight)
    assert int(kept.asked[0]) == Asked.OVER | Asked.APPROACH
    assert (tapped.ticks, tapped.kept, tapped.dt, tapped.motion_dt) == (2, 2, 0.008, 0.004)
    assert cast(object, tapped.recorded()) == "all of it"


def test_without_a_ring_all_goes_through_unseen(robot: RobotBody) -> None:
    note = Note()
    tapped = bus(robot, note)
    tapped.write(ServoGoals(tapped.read().position))
    assert TappedSamples(samples(None), note).sample(0) is None and note.events.take() == []
