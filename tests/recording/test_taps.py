"""The taps of a recorder: all values pass through unchanged, and are noted."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from faulty_bus import FaultKind, FaultyBus, MockFault
from hardware.bus import ServoGoals
from hardware.clock import VirtualClock
from hardware.errors import BusError
from hardware.guard_state import Stop, StopCause
from retarget.frames import SensorSample
from retarget.model.robot import RobotBody, load_robot
from retarget.recording.cycles import READINGS, Asked, Cycles, Done, Shape
from retarget.recording.mcap_writer import Level, Ring
from retarget.recording.taps import STATES_OF_RUN, Note, TappedBus, TappedClock, TappedSamples
from retarget.types import RunState
from rig import Rig

SHAPE = Shape(sensors=1, servos=2, rest=0, human=1, joints=1, landmarks=0, observers=0, human_observers=0)


@pytest.fixture
def rig() -> Rig:
    return Rig(np.zeros((1, 20)))


@pytest.fixture
def note(rig: Rig) -> Note:
    note = Note()
    note.begin(Ring(SHAPE), now=2.0, dt=0.008, machine=rig.machine)
    return note


def cycles(note: Note) -> Cycles:
    assert note.ring is not None
    ring = note.ring
    note.end()
    return ring.take()


def events(note: Note) -> list[tuple[int, str, str]]:
    return [(event.cycle, event.who, event.text) for event in note.events]


def test_before_it_begins_and_after_it_ends_nothing_is_noted(note: Note) -> None:
    other = Note()
    for one in (other, note):
        if one is note:
            note.end()
            note.events.clear()
        one.before()
        one.look()
        one.ask(Asked.OVER)
        one.say("run", "hello")
        one.failed("bus", "read", BusError("gone"))
        one.stopped_outside(None)
        assert one.ring is None and not one.events and one.rows == 0


def test_what_was_asked_is_of_its_cycle(note: Note) -> None:
    note.look()
    note.ask(Asked.APPROACH)
    note.before()
    note.ask(Asked.PAUSED)
    note.ask(Asked.STOP)
    note.look()
    note.ask(Asked.TORQUE_OFF)
    note.ask(Asked.OVER)
    asked = [int(bits) for bits in cycles(note).asked]
    assert asked == [Asked.APPROACH, Asked.STOP | Asked.PAUSED | Asked.TORQUE_OFF | Asked.OVER]


def test_a_stop_from_outside_is_distinguished_from_one_before_it(note: Note, rig: Rig) -> None:
    before = Stop(StopCause.BUS, "gone", 1.0)
    rig.guard.stop = before
    note.stopped_outside(before)
    rig.guard.stop = Stop(StopCause.FALLEN, "over a wire", 2.0)
    note.stopped_outside(before)
    assert events(note) == [(0, "outside", f"{StopCause.FALLEN.value}: over a wire")]
    assert int(cycles(note).asked[0]) == Asked.OUTSIDE


def test_what_failed_is_marked_and_logged(note: Note) -> None:
    note.look()
    note.failed("bus", "read", BusError("no answer"))
    note.failed("bus", "write", BusError("no room"))
    note.failed("bus", "torque", BusError("no torque"))
    assert events(note) == [(0, "bus read", "no answer"), (0, "bus write", "no room"), (0, "bus torque", "no torque")]
    rows = cycles(note)
    assert (rows.read[0], rows.written[0]) == (Done.FAILED, Done.FAILED)


def test_states_and_stops_are_logged_when_they_change(note: Note, rig: Rig) -> None:
    for state in (RunState.APPROACH, RunState.APPROACH, RunState.FOLLOW):
        rig.supervisor.state = state
        note.look()
        note.before()
    rig.supervisor.state, rig.guard.stop = RunState.FAULT, Stop(StopCause.REQUESTED, "enough", 3.0)
    note.look()
    note.before()
    events = list(note.events)
    assert [(event.cycle, event.text) for event in events] == [
        (0, RunState.APPROACH.value),
        (2, RunState.FOLLOW.value),
        (3, f"{StopCause.REQUESTED.value}: enough"),
        (3, RunState.FAULT.value),
    ]
    assert [event.level for event in events][2] is Level.ERROR
    assert cycles(note).state.tolist()[:4] == [
        STATES_OF_RUN[state] for state in (RunState.APPROACH, RunState.APPROACH, RunState.FOLLOW, RunState.FAULT)
    ]


@pytest.fixture(scope="module")
def robot() -> RobotBody:
    return load_robot("op3")


@pytest.fixture
def taps_note(robot: RobotBody) -> Note:
    shape = Shape(2, len(robot.joint_map), 0, 1, 1, 0, 0, 0)
    note = Note()
    note.begin(Ring(shape), now=0.0, dt=0.008, machine=None)
    return note


def row(note: Note) -> Cycles:
    assert note.ring is not None
    return note.ring.rows.taken(np.array([note.ring.at]))


def bus(robot: RobotBody, note: Note, *faults: MockFault) -> TappedBus:
    start = robot.joint_map.to_ticks(robot.posture({})[robot.servo_columns])
    tapped = TappedBus(FaultyBus(robot.joint_map.servos, VirtualClock(), start=start, faults=faults), note)
    tapped.open()
    return tapped


def test_readings_of_the_clock_are_kept_as_far_as_there_is_room(taps_note: Note) -> None:
    clock = VirtualClock(5.0)
    tapped = TappedClock(clock, taps_note)
    for number in range(READINGS + 3):
        assert tapped.now() == 5.0 + number
        clock.advance(1.0)
    kept = row(taps_note)
    assert kept.readings[0] == READINGS and kept.clock[0].tolist() == [5.0 + number for number in range(READINGS)]
    assert taps_note.now == 5.0 + READINGS + 2
    tapped.sleep_until(99.0)
    assert clock.now() == 99.0


@pytest.mark.parametrize(("kind", "what"), [(FaultKind.READ_FAILS, "read"), (FaultKind.WRITE_FAILS, "write")])
def test_what_fails_goes_through_too(kind: FaultKind, what: str, robot: RobotBody, taps_note: Note) -> None:
    tapped = bus(robot, taps_note, MockFault(kind, first=1, cycles=5))
    goals = ServoGoals(tapped.read().position)
    with pytest.raises(BusError):
        tapped.read()
        tapped.write(goals)
    kept = row(taps_note)
    assert (kept.read if what == "read" else kept.written)[0] == Done.FAILED
    assert [event.who for event in taps_note.events] == [f"bus {what}"]


def samples(*said: SensorSample | None) -> Any:
    return SimpleNamespace(
        ticks=2,
        kept=2,
        dt=0.008,
        motion_dt=0.004,
        over=True,
        settled=0.25,
        hold_reason="no performer",
        may_approach=lambda: True,
        listen=lambda: None,
        sample=lambda tick: said[tick],
        recorded=lambda: "all of it",
    )


def test_what_was_followed_is_kept_unchanged(taps_note: Note) -> None:
    weight = np.array([0.5, 1.0])
    said = SensorSample(("a", "b"), np.ones((2, 3)), np.full((2, 4), 0.5), np.array([True, False]), weight)
    tapped = TappedSamples(samples(None, said), taps_note)
    assert tapped.sample(0) is None and row(taps_note).sampled[0] == Done.FAILED
    assert tapped.sample(1) is said
    assert tapped.settled == 0.25 and tapped.over and tapped.may_approach() and tapped.hold_reason == "no performer"
    kept = row(taps_note)
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
    assert TappedSamples(samples(None), note).sample(0) is None and not note.events
