"""What is noted of a cycle: nothing before it begins or after it ends, everything once in between."""

import pytest

from hardware.errors import BusError
from hardware.guard_state import GuardState, Stop, StopCause
from retarget.recording.cycles import Asked, Cycles, Done, Shape
from retarget.recording.events import Level
from retarget.recording.note import STATES, Note
from retarget.recording.ring import Ring

SHAPE = Shape(sensors=1, servos=2, rest=0, human=1, joints=1, landmarks=0, observers=0, human_observers=0)


class Guarded:
    """A guard that is looked at."""

    def __init__(self) -> None:
        self.state, self.paused = GuardState.ARMED, False
        self.stop_reason: Stop | None = None


@pytest.fixture
def guard() -> Guarded:
    return Guarded()


@pytest.fixture
def note(guard: Guarded) -> Note:
    note = Note()
    note.begin(Ring(SHAPE), now=2.0, dt=0.008, robot=None, guard=guard)  # type: ignore[arg-type]
    return note


def cycles(note: Note) -> Cycles:
    assert note.ring is not None
    ring = note.ring
    note.end()
    return ring.take()


def said(note: Note) -> list[tuple[int, str, str]]:
    return [(event.cycle, event.who, event.text) for event in note.events.take()]


def test_before_it_begins_and_after_it_ends_nothing_is_noted(note: Note) -> None:
    other = Note()
    for one in (other, note):
        if one is note:
            note.end()
            note.events.take()
        one.before()
        one.look()
        one.over()
        one.say("run", "hello")
        one.failed("bus", "read", BusError("gone"))
        one.stop_asked(True, stop_before=None)
        assert one.ring is None and one.events.take() == [] and one.rows == 0


def test_what_was_asked_is_of_its_cycle(note: Note, guard: Guarded) -> None:
    note.look()
    note.approach()
    note.before()
    note.stop_asked(False, stop_before=None)
    guard.paused = True
    note.stop_asked(True, stop_before=None)
    note.look()
    note.cut_asked()
    note.over()
    asked = [int(bits) for bits in cycles(note).asked]
    assert asked == [Asked.APPROACH, Asked.STOP | Asked.PAUSED | Asked.CUT | Asked.OVER]


def test_a_cycle_ends_once_however_often_is_asked(note: Note) -> None:
    for _ in range(3):
        note.look()
        note.before()
        note.before()
    assert cycles(note).index.tolist() == [0, 1, 2, 3]


def test_somebody_who_stops_the_guard_is_told_from_one_who_stopped_it_before(note: Note, guard: Guarded) -> None:
    before = Stop(StopCause.BUS, "gone", 1.0)
    guard.stop_reason = before
    note.stop_asked(False, stop_before=before)
    guard.stop_reason = Stop(StopCause.FALLEN, "over a wire", 2.0)
    note.stop_asked(False, stop_before=before)
    assert said(note) == [(0, "outside", f"{StopCause.FALLEN.value}: over a wire")]
    assert int(cycles(note).asked[0]) == Asked.OUTSIDE


def test_what_failed_is_marked_and_said(note: Note) -> None:
    note.look()
    note.failed("bus", "read", BusError("no answer"))
    note.failed("bus", "write", BusError("no room"))
    note.failed("bus", "torque", BusError("no torque"))
    assert said(note) == [(0, "bus read", "no answer"), (0, "bus write", "no room"), (0, "bus torque", "no torque")]
    rows = cycles(note)
    assert (rows.read[0], rows.written[0]) == (Done.FAILED, Done.FAILED)


def test_states_and_stops_are_said_when_they_change(note: Note, guard: Guarded) -> None:
    for state in (GuardState.ARMED, GuardState.ARMED, GuardState.MOVING):
        guard.state = state
        note.look()
        note.before()
    guard.state, guard.stop_reason = GuardState.STOPPED, Stop(StopCause.REQUESTED, "enough", 3.0)
    note.look()
    note.before()
    events = note.events.take()
    assert [(event.cycle, event.text) for event in events] == [
        (0, GuardState.ARMED.value),
        (2, GuardState.MOVING.value),
        (3, f"{StopCause.REQUESTED.value}: enough"),
        (3, GuardState.STOPPED.value),
    ]
    assert [event.level for event in events][2] is Level.ERROR
    assert cycles(note).state.tolist()[:4] == [
        STATES[state] for state in (GuardState.ARMED, GuardState.ARMED, GuardState.MOVING, GuardState.STOPPED)
    ]
