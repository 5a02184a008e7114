"""The latch of a stop: the first reason stays, later ones are added once, and only a healthy robot goes home."""

import pytest

from hardware.guard_state import GuardLimits, StopCause
from hardware.stop_latch import CUT_POWER, GOING_HOME, TORQUE_OFF, StopLatch
from support.messages import shows


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
def test_only_what_is_no_fault_of_the_robot_leads_home(cause: StopCause) -> None:
    latch = StopLatch(GuardLimits())
    assert latch.may_go_home
    latch.latch(cause, "x", 0.0)
    assert latch.may_go_home == (cause in GOING_HOME)
    latch.add(StopCause.FOLLOWING_ERROR, "stuck")
    assert not latch.may_go_home or cause is StopCause.FOLLOWING_ERROR


def test_the_way_home_does_not_spend_the_ticks_of_braking_and_ends_by_itself() -> None:
    latch = StopLatch(GuardLimits(max_brake_ticks=5, max_home_ticks=100))
    latch.begin()
    for _ in range(3):
        assert latch.spend(stood=False) is None
    for tick in range(100):
        assert latch.may_go_home, tick
        assert latch.spend(stood=tick == 0) is None
    assert not latch.may_go_home
    assert [latch.spend(stood=False) for _ in range(3)] == [None, None, 5]


def test_torque_that_is_off_after_all_needs_no_hand() -> None:
    latch = StopLatch(GuardLimits())
    latch.cut(StopCause.BUS, "j1 did not confirm that torque is off. Cut the power by hand", 0.0, powered=True)
    assert latch.stop is not None and latch.stop.powered and latch.stop.reason.endswith(CUT_POWER)
    latch.cut(StopCause.BUS, "again", 0.0, powered=False)
    assert latch.stop.reason.endswith(TORQUE_OFF)
    shows(latch.stop.reason)
