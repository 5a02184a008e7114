"""The guard: arms gently and moves through the filter only."""

import numpy as np
import pytest

from guard_rig import DT, MAP, START, Rig
from hardware.arrays import FloatArray
from hardware.bus import ServoAlert
from hardware.errors import BusError, GuardError
from hardware.guard_state import GuardLimits, GuardState, StopCause
from retarget.approach import approach
from sim.mock_faults import FaultKind, MockFault
from support.messages import refuses, shows


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


def test_a_hold_goes_along_the_callers_way() -> None:
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


def test_nobody_holds_for_ever() -> None:
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


def test_a_goal_now_and_then_does_not_lead() -> None:
    rig = Rig(limits=GuardLimits(max_hold=1.0))
    rig.guard.arm()
    for _ in range(4):
        rig.run(1)
        rig.run(20, lambda _: None)
    assert rig.state() is GuardState.HOLDING
    rig.run(30)
    rig.run(40, lambda _: None)
    assert rig.state() is GuardState.STOPPED


def test_nobody_waits_for_ever_with_torque_before_the_first_goal() -> None:
    rig = Rig(limits=GuardLimits(max_hold=1.0))
    rig.guard.arm()
    rig.run(200, lambda _: None)
    assert rig.state() is GuardState.STOPPED
    rig.guard.release()
    assert not rig.bus.torque_on


def test_a_stop_may_lead_on_to_where_the_robot_is_parked() -> None:
    rig = Rig()
    rig.guard.arm()
    rig.run(20)
    rig.guard.stop("space bar")
    home = MAP.to_radians(START) + np.array([0.1, 0.0, 0.0, 0.0])
    way: list[FloatArray] = []

    def halt() -> FloatArray | None:
        if not rig.gate.at_rest and not way:
            return None
        if not way:
            way.extend(approach(rig.gate.position, home, MAP, speed=0.5, dt=DT))
            way.append(home)
        return way.pop(0) if len(way) > 1 else None

    for _ in range(400):
        if rig.guard.active:
            rig.clock.advance(DT)
            rig.guard.tick(rig.faster, halt)
    assert rig.state() is GuardState.STOPPED
    np.testing.assert_allclose(rig.gate.position, home, atol=1e-9)
    rig.check_goals()


@pytest.mark.parametrize("goal", ["where it stands", "not finite"])
def test_a_robot_that_may_go_home_may_stand_and_think_on_its_way_but_not_for_ever(goal: str) -> None:
    rig = Rig(limits=GuardLimits(max_home_ticks=50))
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
