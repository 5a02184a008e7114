"""The taps of a recorder: all values pass through unchanged, and are noted."""

import numpy as np
import pytest

from faulty_bus import FaultyBus, MockFault
from hardware.clock import VirtualClock
from hardware.errors import BusError
from hardware.guard_state import Stop, StopCause
from retarget.model.robot import RobotBody, load_robot
from retarget.recording.cycles import READINGS, Asked, Cycles, Done, Shape
from retarget.recording.mcap_writer import Level, Ring
from retarget.recording.taps import STATES_OF_RUN, Note, TappedBus, TappedClock
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
