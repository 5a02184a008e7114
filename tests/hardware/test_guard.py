"""The guard: arms gently and moves through the filter only."""

from collections.abc import Callable

import numpy as np
import pytest

from guard_rig import DT, MAP, START, Rig
from hardware.arrays import FloatArray
from hardware.bus import ServoAlert, ServoStates
from hardware.errors import BusError, GuardError
from hardware.guard import COMMANDED_S, CUT_POWER, GOING_TO_REST, TORQUE_OFF, FindGoal, Halt, NoCommand, StopLatch
from hardware.guard_state import GuardLimits, GuardState, StopCause
from messages import refuses, shows
from retarget.run.trajectory import approach
from sim.mock_bus import FaultKind, MockFault


def test_goal_is_present_before_torque() -> None:
    rig = Rig()
    present = rig.guard.arm()
    assert rig.bus.calls == ["write", "torque on"]
    assert rig.guard.sent is not None
    assert rig.guard.sent.tolist() == START.tolist()
    np.testing.assert_allclose(present, MAP.to_radians(START))
    assert rig.state() is GuardState.ARMED
    rig.clock.advance(1.0)
    assert rig.bus.read().position.tolist() == START.tolist()


def test_arming_beyond_a_limit_does_not_move_the_robot() -> None:
    rig = Rig()
    rig.bus._position = np.array([3900.0, 2000.0, 2048.0, 500.0])
    rig.guard.arm()
    rig.clock.advance(1.0)
    assert rig.bus.read().position[0] == 3900


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        (MockFault(FaultKind.MISSING, 0, 9, servo=1), "elbow (id 2)"),
        (MockFault(FaultKind.ALERT, 0, 9, servo=3, alert=ServoAlert.OVERLOAD | 0x40), "head (id 4) OVERLOAD+0x40"),
    ],
)
def test_arming_refuses_an_unhealthy_servo_by_name(fault: MockFault, text: str) -> None:
    rig = Rig(fault)
    with pytest.raises(GuardError) as refusal:
        rig.guard.arm()
    assert text in str(refusal.value)
    assert set(rig.bus.calls) == {"torque off"}
    silent = fault.kind is FaultKind.MISSING  # it cannot confirm that it has no torque
    assert rig.state() is (GuardState.STOPPED if silent else GuardState.IDLE)
    assert (rig.guard.stop_reason is not None and rig.guard.stop_reason.powered) == silent


def test_arming_without_any_servo_says_so() -> None:
    rig = Rig(*(MockFault(FaultKind.MISSING, 0, 9, servo=index) for index in range(4)))
    with refuses(BusError):
        rig.guard.arm()


def test_nothing_is_written_unless_armed() -> None:
    rig = Rig()
    with refuses(GuardError):
        rig.guard.tick(rig.faster)
    assert rig.bus.calls == []


def test_goals_pass_through_the_filter() -> None:
    rig = Rig()
    rig.guard.arm()
    rig.run(1, lambda _: np.full(4, 5.0))  # far beyond everything
    assert rig.bus.goals[-1].tolist() == rig.bus.goals[0].tolist()
    rig.run(50)
    assert rig.state() is GuardState.MOVING
    rig.check_goals()


def test_without_a_goal_the_robot_brakes_and_holds_until_there_is_one() -> None:
    rig = Rig()
    rig.guard.arm()
    rig.run(20)
    rig.run(20, lambda _: None)
    assert rig.gate.at_rest and rig.bus.torque_on
    assert rig.state() is GuardState.HOLDING and rig.guard.active
    stood = rig.gate.position
    rig.run(5)
    assert rig.state() is GuardState.MOVING and (rig.gate.position != stood).any()
    rig.check_goals()


def test_a_hold_follows_the_callers_braking_trajectory() -> None:
    rig = Rig()
    rig.guard.arm()
    rig.run(20)
    speed, asked = rig.gate.velocity, 0

    def gently() -> FloatArray:
        nonlocal asked
        asked += 1
        return rig.gate.position + DT * speed * max(0.0, 1.0 - asked / 40)

    for _ in range(45):
        rig.clock.advance(DT)
        rig.guard.tick(lambda _: None, gently)
    assert rig.state() is GuardState.HOLDING and rig.gate.at_rest
    assert asked == 40
    rig.check_goals()


def test_a_hold_is_bounded_in_time() -> None:
    rig = Rig(limits=GuardLimits(max_hold=1.0))
    rig.guard.arm()
    rig.run(95, lambda _: None)
    assert rig.state() is GuardState.ARMED  # it has not moved yet: it waits
    rig.run(55)
    rig.run(95, lambda _: None)
    rig.run(55)
    rig.run(95, lambda _: None)
    assert rig.state() is GuardState.HOLDING
    rig.run(200, lambda _: None)
    assert rig.state() is GuardState.STOPPED
    assert rig.guard.stop_reason is not None and rig.guard.stop_reason.cause is StopCause.STALE_GOAL
    shows(rig.guard.stop_reason.reason, "1.01", 1)


def test_single_goals_do_not_restart_the_count_of_a_hold() -> None:
    rig = Rig(limits=GuardLimits(max_hold=1.0))
    rig.guard.arm()
    for _ in range(4):
        rig.run(1)
        rig.run(20, lambda _: None)
    assert rig.state() is GuardState.HOLDING
    rig.run(30)
    rig.run(40, lambda _: None)
    assert rig.state() is GuardState.STOPPED


def test_the_wait_with_torque_for_the_first_goal_is_bounded() -> None:
    rig = Rig(limits=GuardLimits(max_hold=1.0))
    rig.guard.arm()
    rig.run(200, lambda _: None)
    assert rig.state() is GuardState.STOPPED
    rig.guard.release()
    assert not rig.bus.torque_on


def test_a_stop_may_continue_to_rest() -> None:
    rig = Rig()
    rig.guard.arm()
    rig.run(20)
    rig.guard.stop("space bar")
    rest = MAP.to_radians(START) + np.array([0.1, 0.0, 0.0, 0.0])
    trajectory: list[FloatArray] = []

    def halt() -> FloatArray | None:
        if not rig.gate.at_rest and not trajectory:
            return None
        if not trajectory:
            trajectory.extend(approach(rig.gate.position, rest, MAP, speed=0.5, dt=DT))
            trajectory.append(rest)
        return trajectory.pop(0) if len(trajectory) > 1 else None

    for _ in range(400):
        if rig.guard.active:
            rig.clock.advance(DT)
            rig.guard.tick(rig.faster, halt)
    assert rig.state() is GuardState.STOPPED
    np.testing.assert_allclose(rig.gate.position, rest, atol=1e-9)
    rig.check_goals()


@pytest.mark.parametrize("goal", ["where it stands", "not finite"])
def test_a_robot_that_may_go_to_rest_may_pause_on_its_trajectory_for_a_bounded_time(goal: str) -> None:
    rig = Rig(limits=GuardLimits(max_rest_ticks=50))
    rig.guard.arm()
    rig.run(20)
    rig.guard.stop("space bar")

    def halt() -> FloatArray | None:
        if not rig.gate.at_rest:
            return None
        return rig.gate.position if goal == "where it stands" else np.full(4, np.nan)

    stood = 0
    while rig.guard.active:
        rig.clock.advance(DT)
        rig.guard.tick(rig.faster, halt)
        stood += rig.gate.at_rest
    assert stood == pytest.approx(50, abs=3)
    assert rig.state() is GuardState.STOPPED and rig.bus.torque_on
    assert rig.guard.stop_reason is not None and rig.guard.stop_reason.reason == "space bar"
    rig.check_goals()


def test_the_ordinary_end_comes_to_rest_unlatched_and_releases() -> None:
    rig = Rig()
    rig.guard.arm()
    rig.run(20)
    rig.guard.rest()
    assert rig.state() is GuardState.STOPPING
    rig.run(20, lambda _: None)
    assert rig.state() is GuardState.ARMED
    assert rig.gate.at_rest
    rig.check_goals()
    rig.guard.release()
    assert rig.state() is GuardState.IDLE
    assert not rig.bus.torque_on


def failing(error: Exception, after: int) -> Callable[[Rig], FindGoal]:
    def build(rig: Rig) -> FindGoal:
        count = 0

        def find_goal(states: ServoStates) -> FloatArray:
            nonlocal count
            count += 1
            if count > after:
                raise error
            return rig.faster(states)

        return find_goal

    return build


def test_a_requested_stop_brakes_and_latches() -> None:
    rig = Rig()
    rig.guard.arm()
    rig.run(20)
    rig.guard.stop("space bar")
    rig.guard.stop("again")
    assert rig.state() is GuardState.STOPPING
    rig.run(100)
    assert rig.state() is GuardState.STOPPED
    assert rig.guard.stop_reason is not None
    assert (rig.guard.stop_reason.cause, rig.guard.stop_reason.reason) == (StopCause.REQUESTED, "space bar")
    assert rig.gate.at_rest
    assert rig.bus.torque_on  # a robot that stands is held
    rig.check_goals()
    with refuses(GuardError):
        rig.guard.tick(rig.faster)
    with refuses(GuardError):
        rig.guard.arm()


def test_a_stop_asked_for_while_finding_a_goal_sends_no_goal() -> None:
    rig = Rig()
    rig.guard.arm()
    rig.run(20)

    def find_goal(states: ServoStates) -> FloatArray:
        rig.guard.stop("enough")
        return rig.faster(states)

    speed = abs(rig.gate.velocity[0])
    rig.run(1, find_goal)
    assert abs(rig.gate.velocity[0]) < speed


@pytest.mark.parametrize(
    ("find_goal", "cause"),
    [
        (failing(ValueError("no such sensor"), 20), StopCause.SOURCE),
        (failing(ZeroDivisionError(), 20), StopCause.SOURCE),
    ],
)
def test_an_exception_while_finding_a_goal_brakes_in_the_same_tick(
    find_goal: Callable[[Rig], FindGoal], cause: StopCause
) -> None:
    rig = Rig()
    rig.guard.arm()
    rig.run(100, find_goal(rig))
    assert rig.state() is GuardState.STOPPED
    assert rig.guard.stop_reason is not None
    assert rig.guard.stop_reason.cause is cause
    assert rig.guard.stop_reason.reason in ("no such sensor", "ZeroDivisionError")
    assert rig.bus.torque_on
    rig.check_goals()


def test_an_exception_in_the_filter_brakes(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig()
    rig.guard.arm()
    rig.run(20)
    monkeypatch.setattr(rig.gate, "admit", lambda goal: 1 // 0)
    rig.run(100)
    assert rig.guard.stop_reason is not None
    assert rig.guard.stop_reason.cause is StopCause.FILTER
    assert rig.gate.at_rest
    rig.check_goals()


def test_a_filter_that_cannot_brake_costs_the_torque(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig()
    rig.guard.arm()
    rig.run(20)
    monkeypatch.setattr(rig.gate, "brake", lambda: np.full(4, np.nan))
    rig.guard.stop("space bar")
    rig.run(3)
    assert rig.state() is GuardState.STOPPED
    assert not rig.bus.torque_on
    assert rig.guard.stop_reason is not None
    shows(rig.guard.stop_reason.reason, "shoulder")


@pytest.mark.parametrize("kind", [FaultKind.READ_FAILS, FaultKind.WRITE_FAILS])
def test_a_dead_bus_costs_the_torque_and_nothing_more_is_written(kind: FaultKind) -> None:
    rig = Rig(MockFault(kind, first=20, cycles=1))
    rig.guard.arm()
    rig.run(100)
    assert rig.state() is GuardState.STOPPED
    assert rig.bus.calls[-1] == "torque off"
    assert not rig.bus.torque_on
    assert rig.guard.stop_reason is not None
    assert rig.guard.stop_reason.cause is StopCause.BUS
    shows(rig.guard.stop_reason.reason)


def test_a_torque_that_cannot_be_switched_off_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(MockFault(FaultKind.WRITE_FAILS, first=20, cycles=1))
    rig.guard.arm()

    def unplugged(on: bool) -> None:
        raise OSError("unplugged")

    monkeypatch.setattr(rig.bus, "torque", unplugged)
    rig.run(100)
    assert rig.guard.stop_reason is not None
    shows(rig.guard.stop_reason.reason)


def test_a_servo_that_is_lost_stops_the_others_once_it_is_too_old() -> None:
    rig = Rig(MockFault(FaultKind.MISSING, first=20, cycles=100, servo=2), limits=GuardLimits(max_age=0.055))
    rig.guard.arm()
    rig.run(24)
    assert rig.state() is GuardState.MOVING
    rig.run(100)
    assert rig.state() is GuardState.STOPPED
    assert rig.guard.stop_reason is not None
    assert rig.guard.stop_reason.cause is StopCause.SERVO_LOST
    assert "waist (id 3)" in rig.guard.stop_reason.reason
    rig.check_goals()


def test_a_short_silence_goes_unnoticed() -> None:
    rig = Rig(MockFault(FaultKind.MISSING, first=20, cycles=3, servo=2))
    rig.guard.arm()
    rig.run(50)
    assert rig.state() is GuardState.MOVING


def test_an_alert_stops() -> None:
    rig = Rig(MockFault(FaultKind.ALERT, first=20, cycles=1, servo=0, alert=ServoAlert.OVERHEATING))
    rig.guard.arm()
    rig.run(100)
    assert rig.state() is GuardState.STOPPED
    assert rig.guard.stop_reason is not None
    assert rig.guard.stop_reason.cause is StopCause.SERVO_ALERT
    assert "shoulder (id 1) OVERHEATING" in rig.guard.stop_reason.reason
    assert rig.guard.stop_reason.time == pytest.approx(0.2)
    rig.check_goals()


def moving() -> Rig:
    rig = Rig()
    rig.guard.arm()
    rig.run(20)
    return rig


def tick(rig: Rig, halt: Halt) -> None:
    rig.clock.advance(DT)
    rig.guard.tick(rig.faster, halt)


def test_a_stop_follows_the_callers_braking_trajectory() -> None:
    """Slower than the filter would brake: what is written is the caller's."""
    rig = moving()
    speed = rig.gate.velocity
    asked: list[FloatArray] = []
    rig.guard.stop("space bar")

    def gently() -> FloatArray | None:
        if rig.gate.at_rest:
            return None
        asked.append(rig.gate.position + DT * speed * max(0.0, 1.0 - (len(asked) + 1) / 40))
        return asked[-1]

    for _ in range(60):
        if rig.guard.active:
            tick(rig, gently)
    assert rig.state() is GuardState.STOPPED and rig.gate.at_rest
    assert len(asked) == 40
    np.testing.assert_allclose(rig.bus.goals[-1], MAP.to_radians(MAP.to_ticks(asked[-1])))
    rig.check_goals()


@pytest.mark.parametrize("trajectory", ["faster than the filter lets", "not finite", "none", "fails"])
def test_without_a_valid_braking_trajectory_the_filter_brakes(trajectory: str) -> None:
    rig = Rig(limits=GuardLimits(max_rest_ticks=0))
    rig.guard.arm()
    rig.run(20)
    rig.guard.stop("space bar")

    def halt() -> FloatArray | None:
        if trajectory == "fails":
            raise ArithmeticError("no trajectory")
        return (
            None
            if trajectory == "none"
            else rig.gate.position
            if trajectory.startswith("faster")
            else np.full(4, np.nan)
        )

    ticks = 0
    while rig.guard.active:
        tick(rig, halt)
        ticks += 1
    assert 3 < ticks < 30
    assert rig.state() is GuardState.STOPPED and rig.gate.at_rest and rig.bus.torque_on
    assert rig.guard.stop_reason is not None and rig.guard.stop_reason.reason == "space bar"
    rig.check_goals()


def test_a_filter_that_cannot_judge_a_goal_still_brakes(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = moving()
    monkeypatch.setattr(rig.gate, "admit", lambda goal: 1 // 0)
    while rig.guard.active:
        tick(rig, lambda: rig.gate.position)
    assert rig.guard.stop_reason is not None and rig.guard.stop_reason.cause is StopCause.FILTER
    assert rig.gate.at_rest and rig.bus.torque_on
    rig.check_goals()


def test_a_trajectory_that_fails_at_the_ordinary_end_is_reported() -> None:
    rig = moving()
    rig.guard.rest()

    def halt() -> FloatArray:
        raise ArithmeticError("no trajectory")

    while rig.state() is GuardState.STOPPING:
        tick(rig, halt)
    assert rig.state() is GuardState.STOPPED
    assert rig.guard.stop_reason is not None and rig.guard.stop_reason.reason == "no trajectory"
    rig.check_goals()


def test_braking_has_a_bound() -> None:
    rig = Rig(limits=GuardLimits(max_brake_ticks=2))
    rig.guard.arm()
    rig.run(20)
    rig.guard.rest()
    rig.run(2)
    assert rig.state() is GuardState.STOPPING
    rig.run(1)
    assert rig.state() is GuardState.STOPPED
    assert rig.guard.stop_reason is not None
    shows(rig.guard.stop_reason.reason, 2)
    assert not rig.bus.torque_on


def test_a_latched_stop_needs_a_person() -> None:
    rig = Rig()
    rig.guard.arm()
    rig.guard.stop("space bar")
    rig.run(1)
    rig.guard.release()
    assert rig.state() is GuardState.STOPPED
    rig.guard.acknowledge()
    assert rig.state() is GuardState.IDLE
    assert rig.guard.stop_reason is None
    rig.guard.arm()
    assert rig.guard.active


def test_a_stop_while_idle_latches_too() -> None:
    rig = Rig()
    rig.guard.stop("not yet")
    with refuses(GuardError):
        rig.guard.arm()
    assert rig.bus.calls == []


def test_the_first_reason_stays_and_a_second_is_added_once() -> None:
    latch = StopLatch(GuardLimits())
    latch.latch(StopCause.REQUESTED, "space bar", 1.0)
    latch.latch(StopCause.BUS, "port gone", 2.0)
    assert latch.stop is not None and (latch.stop.reason, latch.stop.time) == ("space bar", 1.0)
    for _ in range(3):
        latch.add(StopCause.SERVO_ALERT, "servo reports j1 OVERLOAD")
    latch.add(StopCause.TEMPERATURE, "hot")
    assert latch.stop.reason == "space bar, then: servo reports j1 OVERLOAD"
    assert latch.stop.then is StopCause.SERVO_ALERT


@pytest.mark.parametrize("cause", list(StopCause))
def test_the_robot_goes_to_rest_only_if_it_has_no_fault(cause: StopCause) -> None:
    latch = StopLatch(GuardLimits())
    assert latch.may_go_to_rest
    latch.latch(cause, "x", 0.0)
    assert latch.may_go_to_rest == (cause in GOING_TO_REST)
    latch.add(StopCause.FOLLOWING_ERROR, "stuck")
    assert not latch.may_go_to_rest or cause is StopCause.FOLLOWING_ERROR


def test_going_to_rest_uses_no_ticks_of_braking_and_is_bounded() -> None:
    latch = StopLatch(GuardLimits(max_brake_ticks=5, max_rest_ticks=100))
    latch.begin()
    for _ in range(3):
        assert latch.spend(stood=False) is None
    for tick in range(100):
        assert latch.may_go_to_rest, tick
        assert latch.spend(stood=tick == 0) is None
    assert not latch.may_go_to_rest
    assert [latch.spend(stood=False) for _ in range(3)] == [None, None, 5]


def test_torque_that_is_off_after_all_needs_no_hand() -> None:
    latch = StopLatch(GuardLimits())
    latch.latch_torque_off(
        StopCause.BUS, "j1 did not confirm that torque is off. Cut the power by hand", 0.0, powered=True
    )
    assert latch.stop is not None and latch.stop.powered and latch.stop.reason.endswith(CUT_POWER)
    latch.latch_torque_off(StopCause.BUS, "again", 0.0, powered=False)
    assert latch.stop.reason.endswith(TORQUE_OFF)
    shows(latch.stop.reason)


TICK_S = 0.008


def commanded(watch: NoCommand, start: float, seconds: float) -> float:
    """Goals in every tick, from `start` on; the time after them, s."""
    ticks = round(seconds / TICK_S)
    for tick in range(ticks):
        watch.commanded(start + tick * TICK_S)
    return start + ticks * TICK_S


def test_time_without_a_goal_counts_from_its_first_tick() -> None:
    watch = NoCommand()
    watch.commanded(0.0)
    assert watch.lasted(1.0, on_purpose=False) == 0.0
    assert watch.lasted(1.5, on_purpose=False) == 0.5


@pytest.mark.parametrize(
    ("seconds", "forgotten"), [(COMMANDED_S - 4 * TICK_S, False), (COMMANDED_S + 4 * TICK_S, True)]
)
def test_only_half_a_second_of_goals_forgets_earlier_holds(seconds: float, forgotten: bool) -> None:
    watch = NoCommand()
    assert watch.lasted(0.0, on_purpose=False) == 0.0
    now = commanded(watch, 1.0, seconds)
    assert watch.lasted(now, on_purpose=False) == (0.0 if forgotten else pytest.approx(now))


def test_single_goals_do_not_end_the_count() -> None:
    watch, lasted = NoCommand(), 0.0
    for tick in range(1000):
        if tick % 2:
            watch.commanded(tick * TICK_S)
        else:
            lasted = watch.lasted(tick * TICK_S, on_purpose=False)
    assert lasted == pytest.approx(998 * TICK_S)


def test_a_pause_on_purpose_is_not_counted() -> None:
    watch = NoCommand()
    watch.lasted(0.0, on_purpose=False)
    assert watch.lasted(5.0, on_purpose=True) == 0.0
    assert watch.lasted(6.0, on_purpose=False) == 1.0
