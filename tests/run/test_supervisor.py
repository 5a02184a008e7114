"""The state machine of a run: its table, its time limits, and what it latches."""

from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from guard_rig import Rig
from hardware.clock import VirtualClock
from hardware.errors import BusError
from hardware.guard import FALL_DRIVE, Torque
from hardware.guard_state import Stop, StopCategory, StopCause
from messages import shows
from planted import failing
from retarget.human.samples import PerformerInput
from retarget.run.supervisor import (
    AT_RISK,
    BUS_SILENT,
    COMMANDED_S,
    LONGEST_BRAKE_S,
    LONGEST_FALL_S,
    LONGEST_HOLD_S,
    LONGEST_RETURN_S,
    LONGEST_STOP_S,
    STATES,
    TRANSITIONS,
    End,
    Event,
    OperatorInput,
    Situation,
    Supervisor,
)
from retarget.types import RunState
from state_tables import tables_of_states

PAGE = Path(__file__).resolve().parents[2] / "docs" / "stops.md"
FOLLOWED = Situation(approached=True)
LOST = Situation(hold_reason="no data", approached=True)
STANDS = Situation(approached=True, stands=True, end=End.AT_REST)


NOTHING, MOVES = OperatorInput(), PerformerInput()
STOP, TORQUE_OFF = OperatorInput(stop="space bar"), OperatorInput(torque_off=True)


class Run(Rig):
    """A supervisor in a state, and an armed guard."""

    def __init__(self, state: RunState = RunState.FOLLOW) -> None:
        super().__init__()
        self.supervisor = Supervisor()
        self.arm()
        for event in (Event.READY, Event.ARMED, Event.ARRIVED):
            assert self.supervisor.take(event, 0.0)
        self.supervisor.state = state

    def step(
        self, now: float, situation: Situation, operator: OperatorInput = NOTHING, performer: PerformerInput = MOVES
    ) -> RunState:
        """The state of a tick at `now`, s."""
        return self.supervisor.step(now, operator, performer, situation, self.guard)

    def fail(self, now: float, reason: str, cause: StopCause = StopCause.SOURCE) -> RunState:
        """The state after a tick that fails."""
        self.supervisor.fail(now, reason, cause, self.guard, may_brake=cause is not StopCause.BUS)
        return self.supervisor.state

    @property
    def stop(self) -> Stop:
        assert self.guard.stop is not None
        return self.guard.stop


# The table.


def test_every_state_with_torque_can_be_switched_off_at_once() -> None:
    for state, row in STATES.items():
        if row.torque:
            transition = TRANSITIONS[state, Event.TORQUE_OFF]
            assert (transition.to, transition.category) == (RunState.FAULT, StopCategory.TORQUE_OFF)


def test_every_state_is_reached_and_every_one_with_torque_ends() -> None:
    reached = {RunState.IDLE}
    for _ in STATES:
        reached |= {row.to for (state, _), row in TRANSITIONS.items() if state in reached}
    assert reached == set(RunState) == set(STATES)
    ends = {RunState.OFF, RunState.FAULT}
    for _ in STATES:
        ends |= {state for (state, _), row in TRANSITIONS.items() if row.to in ends}
    assert {state for state, row in STATES.items() if row.torque} <= ends


def test_torque_comes_on_only_by_arming() -> None:
    on = {(state, event) for (state, event), row in TRANSITIONS.items() if STATES[row.to].torque}
    assert {one for one in on if not STATES[one[0]].torque} == {(RunState.ARMING, Event.ARMED)}


def test_a_robot_that_stops_never_follows_again() -> None:
    after = {RunState.STOPPING}
    for _ in STATES:
        after |= {row.to for (state, _), row in TRANSITIONS.items() if state in after}
    assert {state.name for state in after} == {
        *("STOPPING", "RETURN_TO_STANCE", "GO_TO_REST", "STANDING", "FALLING", "OFF", "FAULT")
    }
    assert {row.to for (state, _), row in TRANSITIONS.items() if state is RunState.FALLING} == {RunState.FAULT}


FALLS = Situation(approached=True, falls="the robot falls")


@pytest.mark.parametrize("state", [state for state, event in TRANSITIONS if event is Event.FALLS])
def test_a_robot_that_falls_gives_way_and_lets_go_once_it_lies(state: RunState) -> None:
    """Whatever it does, and whatever else is wrong."""
    run = Run(state)
    run.guard.latch(StopCause.TEMPERATURE, "hot")
    assert run.step(1.0, FALLS, STOP) is RunState.FALLING
    assert run.bus.drives == [FALL_DRIVE] and run.bus.torque_on
    assert run.stop.reason == "hot, then: the robot falls"
    for now in (1.1, 1.0 + LONGEST_FALL_S):
        assert run.step(now, FALLS, STOP) is RunState.FALLING
    assert run.step(1.1 + LONGEST_FALL_S, FALLS, STOP) is RunState.FAULT
    assert run.bus.drives == [FALL_DRIVE]
    assert run.bus.calls[-1] == "torque off"


def test_a_long_stop_makes_no_fall_shorter() -> None:
    run = Run()
    run.step(0.0, Situation(), STOP)
    late = LONGEST_STOP_S - 0.5
    run.supervisor.state, run.supervisor.since = RunState.GO_TO_REST, late - 1.0
    for now in (late, late + 0.9 * LONGEST_FALL_S):
        assert run.step(now, FALLS) is RunState.FALLING


def test_a_robot_whose_drive_cannot_be_limited_loses_its_torque(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Run()
    monkeypatch.setattr(run.bus, "limit_drive", failing(run.bus.limit_drive, BusError("gone"), [1]))
    assert run.step(1.0, FALLS) is RunState.FALLING
    assert run.bus.calls[-1] == "torque off" and run.guard.torque is Torque.OFF
    assert run.step(1.1, FALLS) is RunState.FAULT


def test_every_state_in_which_the_robot_neither_follows_nor_stands_has_a_time_limit() -> None:
    unlimited = {state for state, row in STATES.items() if row.torque and row.limit_s == inf}
    assert unlimited == {RunState.APPROACH, RunState.FOLLOW, RunState.STANDING}
    assert all((state, Event.TIMEOUT) in TRANSITIONS for state, row in STATES.items() if row.limit_s < inf)


def test_pages_name_every_state_and_every_transition() -> None:
    table, names = tables_of_states(), [state.value for state in STATES]
    assert all(f"\n| {name} |" in table for name in names) and all(event.value in table for event in Event)
    assert ", ".join(f"`{name}`" for name in names) in " ".join(PAGE.read_text(encoding="utf-8").split())


@given(events=st.lists(st.sampled_from(Event), max_size=30))
def test_no_order_of_events_leaves_the_table(events: list[Event]) -> None:
    supervisor = Supervisor()
    for event in events:
        before = supervisor.state
        assert supervisor.take(event, 1.0) == ((before, event) in TRANSITIONS)
        assert supervisor.state is (TRANSITIONS[before, event].to if (before, event) in TRANSITIONS else before)


def test_a_live_performer_is_measured_before_the_robot_is_armed() -> None:
    supervisor = Supervisor()
    with pytest.raises(ValueError):
        supervisor.enter(RunState.CHECKING_SIDES, VirtualClock())
    for state in (RunState.COUNTDOWN, RunState.CALIBRATING, RunState.CHECKING_SIDES):
        supervisor.enter(state, VirtualClock())
        assert supervisor.state is state
    assert supervisor.take(Event.READY, 0.0) and supervisor.state is RunState.ARMING
    with pytest.raises(ValueError):
        supervisor.enter(RunState.APPROACH, VirtualClock())


# What a situation leads to.


def test_a_hold_ends_in_a_stop_with_its_reason() -> None:
    run = Run()
    run.step(1.0, LOST)
    assert run.step(1.0 + LONGEST_HOLD_S, LOST) is RunState.HOLD
    assert run.step(1.1 + LONGEST_HOLD_S, LOST) is RunState.STOPPING
    assert run.stop.cause is StopCause.STALE_GOAL
    shows(run.stop.reason)


def test_a_hold_for_a_bus_that_answers_now_and_then_says_how_often() -> None:
    run = Run()
    states, waits = run.bus.read(), Situation(hold_reason=BUS_SILENT, approached=True)
    quiet = replace(states, valid=np.zeros(4, dtype=np.bool_), age=np.full(4, 0.01))
    for tick in range(600):
        is_silent, now = tick % 2 == 0, 1.0 + 0.01 * tick
        run.guard.health.buses.silence(replace(quiet if is_silent else states, time=now))
        run.step(now, waits if is_silent else FOLLOWED)
    assert run.supervisor.state is RunState.STOPPING
    shows(run.stop.reason)


def test_a_robot_that_has_lost_a_limb_goes_by_the_stance_to_rest() -> None:
    run = Run()
    run.guard.latch(StopCause.LIMB_LOST, "an arm is silent")
    assert run.step(1.0, FOLLOWED) is RunState.STOPPING
    assert run.step(1.2, STANDS) is RunState.RETURN_TO_STANCE
    assert run.step(1.3, Situation(arrived=True)) is RunState.GO_TO_REST
    run.guard.latch(StopCause.SERVO_LOST, "a leg is silent")
    assert run.step(1.4, Situation()) is RunState.STOPPING
    assert run.step(1.6, STANDS) is RunState.FAULT


@pytest.mark.parametrize(("between", "ends"), [(0.9 * COMMANDED_S, True), (1.1 * COMMANDED_S, False)])
def test_holds_with_single_goals_between_them_count_as_one(between: float, ends: bool) -> None:
    run = Run()
    run.step(10.0, LOST)
    run.step(13.0, FOLLOWED)
    run.step(13.0 + between, LOST)
    state = run.step(10.1 + LONGEST_HOLD_S, LOST)
    assert state is (RunState.STOPPING if ends else RunState.HOLD)


def test_a_pause_on_purpose_is_not_counted() -> None:
    run = Run()
    paused, waits = PerformerInput(paused=True), Situation(approached=True, hold_reason="paused by the operator")
    for second in range(100):
        assert run.step(float(second), waits, performer=paused) is RunState.HOLD
    assert run.step(99.0 + LONGEST_HOLD_S, LOST) is RunState.HOLD


@pytest.mark.parametrize("state", AT_RISK)
@pytest.mark.parametrize("over", [False, True])
def test_a_stop_that_is_asked_for_and_the_end_stop_the_robot(state: RunState, over: bool) -> None:
    run = Run(state)
    operator, performer = NOTHING if over else STOP, PerformerInput(over=over)
    assert run.step(1.0, Situation(), operator, performer) is RunState.STOPPING
    assert run.guard.stop is None if over else run.stop.cause is StopCause.REQUESTED


@pytest.mark.parametrize(
    "state", [state for state, row in STATES.items() if row.torque and state not in (*AT_RISK, RunState.STANDING)]
)
def test_a_forced_stop_switches_torque_off_at_once(state: RunState) -> None:
    run = Run(state)
    assert run.step(1.0, Situation(arrived=True, stands=True), TORQUE_OFF) is RunState.FAULT
    assert run.guard.torque is Torque.OFF and not run.bus.torque_on
    assert run.stop.cause is StopCause.REQUESTED


@pytest.mark.parametrize("state", [state for state, row in STATES.items() if row.torque])
def test_torque_that_the_guard_switched_off_ends_the_run(state: RunState) -> None:
    run = Run(state)
    run.guard.switch_off(StopCause.BUS_SILENT, "no answer")
    assert run.step(1.0, FOLLOWED) is RunState.FAULT


@pytest.mark.parametrize("state", AT_RISK)
def test_a_stop_that_the_guard_latched_stops_the_robot(state: RunState) -> None:
    run = Run(state)
    run.guard.latch(StopCause.STALE_GOAL, "no tick")
    assert run.step(1.0, FOLLOWED) is RunState.STOPPING
    assert run.step(1.1, STANDS) is RunState.RETURN_TO_STANCE


def test_a_stop_in_the_last_tick_keeps_its_reason() -> None:
    run = Run()
    assert run.step(1.0, Situation(), STOP, PerformerInput(over=True)) is RunState.STOPPING
    assert run.stop.reason == "space bar"


def test_a_hold_that_was_too_long_does_not_resume() -> None:
    run = Run()
    run.step(1.0, LOST)
    assert run.step(1.1 + LONGEST_HOLD_S, FOLLOWED) is RunState.STOPPING


@pytest.mark.parametrize("state", [*AT_RISK, RunState.RETURN_TO_STANCE, RunState.GO_TO_REST])
def test_a_fault_brakes_and_does_not_lead_to_rest(state: RunState) -> None:
    run = Run(state)
    run.guard.latch(StopCause.SERVO_ALERT, "too hot")
    assert run.step(1.0, FOLLOWED) is RunState.STOPPING
    assert run.guard.torque is Torque.ON
    assert run.step(1.1, STANDS) is RunState.FAULT


def test_a_stop_goes_by_the_stance_to_rest() -> None:
    """Straight to rest from the straight approach."""
    run, there = Run(), Situation(arrived=True, stands=True)
    run.step(1.0, Situation(), STOP)
    assert run.step(1.1, Situation(approached=True)) is RunState.STOPPING
    assert run.step(1.2, STANDS) is RunState.RETURN_TO_STANCE
    assert run.step(1.3, there) is RunState.GO_TO_REST
    assert run.step(1.4, there) is RunState.OFF
    assert run.supervisor.over and not run.supervisor.torque
    run = Run(RunState.APPROACH)
    run.step(1.0, Situation(), STOP)
    assert run.step(1.1, Situation(stands=True, straight=True, end=End.AT_REST)) is RunState.GO_TO_REST


@pytest.mark.parametrize("fails", [False, True])
def test_a_return_to_stance_that_is_broken_off_is_not_tried_again(fails: bool) -> None:
    run = Run()
    run.step(1.0, Situation(), STOP)
    assert run.step(1.1, STANDS) is RunState.RETURN_TO_STANCE
    now = 1.2 + LONGEST_RETURN_S * (not fails)
    assert (run.fail(now, "it broke") if fails else run.step(now, Situation())) is RunState.STOPPING
    assert run.step(now + 0.1, STANDS) is RunState.GO_TO_REST


@pytest.mark.parametrize("state", [RunState.STOPPING, RunState.RETURN_TO_STANCE, RunState.GO_TO_REST])
def test_a_stop_has_a_bound_as_a_whole(state: RunState) -> None:
    run = Run()
    run.step(1.0, Situation(), STOP)
    run.supervisor.state, run.supervisor.since = state, 1.0 + LONGEST_STOP_S
    assert run.step(1.0 + LONGEST_STOP_S, Situation()) is state
    assert run.step(1.1 + LONGEST_STOP_S, Situation()) is TRANSITIONS[state, Event.TIMEOUT].to


def test_braking_has_a_bound() -> None:
    run = Run()
    run.step(1.0, Situation(), STOP)
    assert run.step(1.1 + LONGEST_BRAKE_S, Situation()) is RunState.FAULT
    assert run.guard.torque is Torque.OFF
    shows(run.stop.reason)


@pytest.mark.parametrize("state", [RunState.RETURN_TO_STANCE, RunState.GO_TO_REST])
def test_the_way_to_rest_has_a_bound(state: RunState) -> None:
    run = Run(state)
    after = run.step(1.0 + STATES[state].limit_s, Situation())
    assert after is TRANSITIONS[state, Event.TIMEOUT].to
    assert (run.guard.stop is not None) == (state is RunState.GO_TO_REST), "a run that does not end at rest failed"


# A tick that fails.


@pytest.mark.parametrize("state", AT_RISK)
def test_a_failure_stops_the_robot_with_its_cause(state: RunState) -> None:
    run = Run(state)
    assert run.fail(1.0, "it broke") is RunState.STOPPING
    assert (run.stop.cause, run.stop.reason) == (StopCause.SOURCE, "it broke")


@pytest.mark.parametrize("state", [state for state, row in STATES.items() if row.torque])
def test_a_failure_of_the_bus_costs_the_torque(state: RunState) -> None:
    run = Run(state)
    assert run.fail(1.0, "port gone", StopCause.BUS) is RunState.FAULT and run.guard.torque is Torque.OFF


def test_only_the_operator_a_servo_or_the_bus_take_the_torque_of_a_robot_that_cannot_go_to_rest() -> None:
    run = Run(RunState.GO_TO_REST)
    assert run.fail(1.0, "it broke") is RunState.STANDING
    run.fail(1.05, "it broke again", StopCause.FILTER)
    for now in (1.1, 1e3, 1e6):
        assert run.step(now, STANDS) is RunState.STANDING
    assert run.guard.torque is Torque.ON and run.stop.reason == "it broke, then: it broke again"
    assert run.step(2e6, Situation(), TORQUE_OFF) is RunState.OFF
    run = Run(RunState.STANDING)
    run.guard.latch(StopCause.TEMPERATURE, "hot")
    assert run.step(1.1, STANDS) is RunState.FAULT


@pytest.mark.parametrize("straight", [False, True])
def test_a_run_that_is_to_end_standing_stands_in_its_stance_or_where_it_was_on_its_way_there(straight: bool) -> None:
    run = Run(RunState.STOPPING)
    stands = Situation(stands=True, straight=straight, end=End.STANDING)
    if not straight:
        assert run.step(1.1, stands) is RunState.RETURN_TO_STANCE
        stands = Situation(arrived=True, end=End.STANDING)
    assert run.step(1.2, stands) is RunState.STANDING
