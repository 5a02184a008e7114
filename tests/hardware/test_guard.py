"""The guard: arms gently, writes nothing but the gate's next goal, and latches the first reason of a stop."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from faulty_bus import FaultKind, MockFault
from guard_rig import DT, MAP, START, Rig, moving, silent
from hardware.bus import ServoAlert
from hardware.errors import BusError, GuardError
from hardware.guard import CUT_POWER, TORQUE_OFF, CheckedGoal, Torque
from hardware.guard_state import BEARABLE, GuardLimits, StopCause
from messages import refuses, shows
from retarget.safety.gate import Gate


def test_goal_is_present_before_torque_and_beyond_a_limit_it_does_not_move_the_robot_either() -> None:
    rig = Rig()
    present = rig.arm()
    assert rig.bus.calls == ["write", "torque on"] and rig.guard.torque is Torque.ON
    assert rig.guard.sent is not None and rig.guard.sent.tolist() == START.tolist()
    np.testing.assert_allclose(present, MAP.to_radians(START))
    rig.clock.advance(1.0)
    assert rig.bus.read().position.tolist() == START.tolist()
    rig = Rig()
    rig.bus._position = np.array([3900.0, 2000.0, 2048.0, 500.0])
    rig.arm()
    rig.clock.advance(1.0)
    assert rig.bus.read().position[0] == 3900


def test_a_goal_elsewhere_than_the_robot_switches_no_torque_on() -> None:
    rig = Rig()
    present = rig.guard.present()
    with refuses(GuardError):
        rig.guard.arm(rig.gate.begin(present + 0.1))
    assert not rig.bus.torque_on and rig.guard.torque is Torque.OFF and set(rig.bus.calls) == {"torque off"}


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        (*silent(1, first=0), "elbow (id 2)"),
        (MockFault(FaultKind.ALERT, 0, 9, servo=3, alert=ServoAlert.OVERLOAD | 0x40), "head (id 4) OVERLOAD+0x40"),
    ],
)
def test_arming_refuses_an_unhealthy_servo_by_name(fault: MockFault, text: str) -> None:
    rig = Rig(fault)
    with refuses(GuardError, text):
        rig.arm()
    assert set(rig.bus.calls) == {"torque off"}
    missing = fault.kind is FaultKind.MISSING  # it cannot confirm that it has no torque
    assert rig.guard.torque is (Torque.UNCONFIRMED if missing else Torque.OFF)
    assert (rig.guard.stop is not None and rig.guard.stop.powered) == missing
    with refuses(BusError):
        Rig(*silent(0, 1, 2, 3, first=0)).arm()


def test_nothing_is_written_without_torque() -> None:
    rig = Rig()
    goal = rig.gate.begin(MAP.to_radians(START))
    with refuses(GuardError):
        rig.guard.write(goal)
    rig.arm()
    rig.guard.release()
    with refuses(GuardError):
        rig.guard.write(rig.brake())
    assert rig.bus.calls == ["write", "torque on", "torque off"]


def test_only_a_gate_makes_a_checked_goal() -> None:
    rig = moving()
    goal = rig.faster()
    with pytest.raises(TypeError, match="gate"):
        CheckedGoal(goal.joints, goal.posture, goal.displacement, goal.stop, True, None, None)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="gate"):
        replace(goal, seal=object())  # type: ignore[arg-type]
    for other in (goal.joints, None, rig.bus):
        with pytest.raises(GuardError):
            rig.guard.write(other)  # type: ignore[arg-type]
    with refuses(GuardError):
        rig.guard.write(replace(goal, joints=goal.joints + 0.1))
    with pytest.raises(ValueError, match="read-only"):
        goal.joints[0] = 1.0


def test_a_goal_is_written_once_and_in_order() -> None:
    rig = moving()
    before, old, new = rig.guard.goal, rig.faster(), rig.faster()
    assert before is not None
    rig.guard.write(new)
    written = len(rig.bus.goals)
    for goal in (new, old):
        with pytest.raises(GuardError):
            rig.guard.write(goal)
    with pytest.raises(GuardError):  # the seal is of the last goal that the gate made
        rig.guard.write(rig.gate.brake(before))
    with pytest.raises(GuardError):
        rig.guard.write(replace(rig.brake()))
    assert len(rig.bus.goals) == written and rig.guard.goal is new


def test_a_goal_of_another_gate_is_refused() -> None:
    rig, other = moving(), Gate(MAP, dt=DT)
    assert rig.guard.goal is not None
    for goal in (other.begin(MAP.to_radians(START)), other.brake(rig.guard.goal)):
        with pytest.raises(GuardError):
            rig.guard.write(goal)


def test_a_servo_that_is_lost_is_latched_once_it_is_too_old() -> None:
    rig = moving(*silent(2), limits=GuardLimits(max_age=0.055))
    rig.run(5)
    assert rig.stopped() is None
    rig.run(3)
    assert rig.cause() is StopCause.SERVO_LOST and "waist (id 3)" in rig.reason()
    assert not rig.guard.may_go_to_rest
    # What it said last is old: it says nothing about where the joint is that moves.
    rig = moving(*silent(0), limits=GuardLimits(max_age=0.1, following_error=0.1), ticks=99)
    assert rig.cause() is StopCause.SERVO_LOST


def test_an_alert_is_latched_with_the_servo() -> None:
    rig = moving(MockFault(FaultKind.ALERT, first=20, cycles=1, servo=0, alert=ServoAlert.OVERHEATING))
    rig.run(30)
    assert rig.cause() is StopCause.SERVO_ALERT
    assert "shoulder (id 1) OVERHEATING" in rig.reason()


def pause(rig: Rig, *, suspended: bool, seconds: float = 5.0) -> None:
    """The process does other things, or is not there."""
    rig.clock.sleep_until(rig.clock.now() + seconds) if suspended else rig.clock.advance(seconds)


@pytest.mark.parametrize(("suspended", "seconds"), [(False, 0.2), (False, 5.0), (True, 5.0)])
@pytest.mark.parametrize("before", ["a tick", "writing"])
def test_a_pause_is_latched_and_a_suspended_process_is_named(before: str, suspended: bool, seconds: float) -> None:
    rig = moving()
    if before == "writing":
        rig.clock.advance(DT)
        rig.read()
    goal = rig.faster()
    pause(rig, suspended=suspended, seconds=seconds)
    if before == "writing":
        rig.guard.write(goal)
    rig.read()
    assert rig.cause() is StopCause.STALE_GOAL
    assert ("suspended" in rig.reason()) == suspended
    shows(rig.reason())


def test_simulated_servos_wait_for_a_slow_host_and_a_suspension_is_named() -> None:
    rig = moving(limits=GuardLimits(max_pause=np.inf))
    pause(rig, suspended=False)
    rig.run(1)
    assert rig.guard.stop is None and not rig.guard.health.warnings.take_news()
    pause(rig, suspended=True)
    rig.run(1)
    assert rig.guard.stop is None
    shows(rig.guard.health.warnings.take_news(), "5.0 s", "suspended")
    rig.run(3)
    assert not rig.guard.health.warnings.take_news()


def test_a_servo_that_gives_way_in_a_fall_is_not_judged_for_it() -> None:
    for yields in (False, True):
        rig = Rig(MockFault(FaultKind.STUCK, first=5, cycles=1000), limits=GuardLimits(following_error=0.2))
        rig.arm()
        if yields:
            rig.guard.reduce_drive()
        rig.run(100)
        stop = rig.guard.stop
        assert (stop is None) if yields else (stop is not None and stop.cause is StopCause.FOLLOWING_ERROR)


def test_the_first_reason_stays_and_one_later_fault_is_added() -> None:
    rig = moving()
    rig.guard.latch(StopCause.REQUESTED, "space bar")
    rig.guard.latch(StopCause.STALE_GOAL, "no data")
    assert rig.reason() == "space bar" and rig.guard.may_go_to_rest
    rig.guard.latch(StopCause.VOLTAGE, "no supply")
    rig.guard.latch(StopCause.CURRENT, "too much")
    assert rig.reason() == "space bar, then: no supply" and not rig.guard.may_go_to_rest


@pytest.mark.parametrize("cause", StopCause)
def test_the_robot_goes_to_rest_only_if_it_has_no_fault(cause: StopCause) -> None:
    rig = moving()
    rig.guard.latch(cause, "why")
    assert rig.guard.may_go_to_rest == (cause in BEARABLE)


ARM = GuardLimits(max_age=0.055, sustained_error=0.05, limbs=(True, True, False, False))
"""Shoulder and elbow carry nothing."""


def test_servos_of_a_limb_that_fall_silent_are_named_once_and_the_robot_may_go_to_rest() -> None:
    for later in (22, 60):  # at about the same time, or long after
        rig = moving(*silent(0), *silent(1, first=later), limits=ARM, ticks=219)
        assert rig.cause() is StopCause.LIMB_LOST and rig.guard.may_go_to_rest
        shows(rig.reason())
        assert ("shoulder (id 1), then: " in rig.reason()) == (later == 60) and "elbow (id 2)" in rig.reason()
        assert rig.guard.health.lost.tolist() == [True, True, False, False] and rig.bus.torque_on
    rig = moving(*silent(0, 2), limits=ARM, ticks=49)
    assert rig.cause() is StopCause.SERVO_LOST
    assert not rig.guard.may_go_to_rest, "a servo that carries the robot is no limb, whatever else is lost"


def test_a_lost_servo_is_asked_for_nothing_and_stands_when_it_is_back() -> None:
    alert = MockFault(FaultKind.ALERT, first=60, cycles=1, servo=1, alert=ServoAlert.OVERLOAD)
    rig = moving(*silent(0, 1, cycles=30), alert, limits=ARM)
    rig.run(10)
    kept, lost = rig.bus.goals[-1], rig.stopped()
    assert lost is not None
    for _ in range(60):
        rig.clock.advance(DT)
        rig.read()
        rig.guard.write(rig.faster())  # the gate leads all joints to rest
    assert rig.bus.read().valid.all() and rig.stopped() == lost
    assert rig.guard.goal is not None and abs(rig.guard.goal.joints[0] - kept[0]) > 0.1
    assert rig.bus.goals[-1][0] == kept[0], "one that is back must not jump"


@pytest.mark.parametrize("other", [MockFault(FaultKind.HOT, 60, 99, servo=3, value=90.0), *silent(2, first=60)])
def test_a_fault_of_another_servo_ends_the_way_to_rest(other: MockFault) -> None:
    rig = moving(*silent(0, 1), other, limits=replace(ARM, max_temperature=65.0))
    rig.run(30)
    before = rig.stopped()
    assert before is not None and before.is_bearable and before.then is None
    rig.run(30)
    stop = rig.stopped()
    assert stop is not None and stop.cause is StopCause.LIMB_LOST and not rig.guard.may_go_to_rest
    assert stop.then is (StopCause.TEMPERATURE if other.kind is FaultKind.HOT else StopCause.SERVO_LOST)


def test_a_latched_stop_keeps_the_robot_from_being_armed_again() -> None:
    rig = moving()
    rig.guard.latch(StopCause.REQUESTED, "space bar")
    rig.guard.release()
    with refuses(GuardError):
        rig.guard.present()


def test_a_stop_between_reading_and_arming_leaves_torque_off() -> None:
    rig = Rig()
    goal = rig.gate.begin(rig.guard.present())
    rig.guard.latch(StopCause.REQUESTED, "space bar")
    with pytest.raises(GuardError):
        rig.guard.arm(goal)
    assert set(rig.bus.calls) == {"torque off"} and rig.guard.torque is Torque.OFF


def test_torque_that_is_off_after_all_needs_no_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = moving()
    rig.guard.latch(StopCause.REQUESTED, "space bar")
    torque = rig.bus.torque
    monkeypatch.setattr(rig.bus, "torque", Mock(side_effect=OSError("unplugged")))
    with refuses(OSError):
        rig.guard.release()
    unconfirmed = rig.guard.torque
    assert unconfirmed is Torque.UNCONFIRMED and rig.reason().endswith(CUT_POWER)
    monkeypatch.setattr(rig.bus, "torque", torque)
    rig.guard.switch_off(StopCause.REQUESTED, "again")
    assert rig.guard.torque is Torque.OFF and rig.reason().endswith(TORQUE_OFF)
    assert rig.reason().count("(") == 1


def test_a_servo_that_is_lost_may_have_torque_in_the_end() -> None:
    rig = moving(*silent(2), ticks=119)
    with refuses(BusError, "waist"):
        rig.guard.release()
    assert rig.bus.torque_on and rig.guard.stop is not None and rig.guard.stop.powered
    shows(rig.reason())
    assert rig.reason().count("cut the power") == 1


@pytest.mark.parametrize("error", [BusError("port gone"), KeyboardInterrupt("port gone")])
@pytest.mark.parametrize("stuck", [False, True])
def test_what_interrupts_arming_leaves_nothing_unsaid(
    error: BaseException, stuck: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = Rig()
    torque = rig.bus.torque

    def switch(on: bool) -> None:
        if on or not stuck:
            torque(on)
        if on or stuck:
            raise error if on else BusError("no answer")

    monkeypatch.setattr(rig.bus, "torque", switch)
    with refuses(type(error)):
        rig.arm()
    assert rig.guard.stop is not None and rig.bus.torque_on == rig.guard.stop.powered == stuck
    assert rig.reason() == "port gone" + (CUT_POWER if stuck else TORQUE_OFF)
    with refuses(GuardError):
        rig.arm()


def test_a_refused_arming_with_torque_that_stays_on_is_latched_and_reported() -> None:
    rig = Rig(MockFault(FaultKind.HOT, 0, 99, servo=1, value=95.0), limits=GuardLimits(max_temperature=60.0))
    rig.bus._torque[:] = True  # of an earlier run
    unconfirmed = BusError("waist (id 3) did not confirm that torque is off. Cut the power by hand")
    rig.bus.torque = Mock(side_effect=unconfirmed)  # type: ignore[method-assign]
    with refuses(GuardError):
        rig.arm()
    assert rig.guard.stop is not None and rig.guard.stop.powered
    shows(rig.reason())
