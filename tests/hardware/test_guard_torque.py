"""Torque: off in the end whatever happens, and said where a servo does not confirm it."""

import pytest

from guard_rig import Rig
from hardware.errors import BusError, GuardError
from hardware.guard_state import GuardLimits, GuardState, StopCause
from messages import refuses, shows
from sim.mock_bus import FaultKind, MockFault

FOR_EVER = 10**6


def reason(rig: Rig) -> str:
    assert rig.guard.stop_reason is not None
    return rig.guard.stop_reason.reason


def powered(rig: Rig) -> bool:
    return rig.guard.stop_reason is not None and rig.guard.stop_reason.powered


def test_a_servo_that_is_lost_may_have_torque_in_the_end() -> None:
    rig = Rig(MockFault(FaultKind.MISSING, first=20, cycles=FOR_EVER, servo=2))
    rig.guard.arm()
    rig.run(100)
    assert rig.state() is GuardState.STOPPED and not powered(rig)
    with refuses(BusError, "waist"):
        rig.guard.release()
    assert rig.bus.torque_on and powered(rig) and rig.state() is GuardState.STOPPED
    shows(reason(rig))
    assert reason(rig).count("cut the power") == 1
    with refuses(BusError, "waist"):
        rig.guard.acknowledge()
    assert rig.state() is GuardState.STOPPED


def test_torque_off_that_a_servo_does_not_receive_is_not_safe() -> None:
    lost = MockFault(FaultKind.MISSING, first=20, cycles=FOR_EVER, servo=2)
    rig = Rig(lost, MockFault(FaultKind.WRITE_FAILS, first=22, cycles=1))
    rig.guard.arm()
    rig.run(30)
    assert rig.bus.torque_on and powered(rig)
    shows(reason(rig))
    assert not rig.bus._torque[[0, 1, 3]].any()


def test_a_second_try_that_succeeds_is_believed() -> None:
    rig = Rig(MockFault(FaultKind.MISSING, first=20, cycles=2, servo=2))
    rig.guard.arm()
    rig.run(20)
    rig.guard.force_torque_off("space bar, twice")
    assert powered(rig)
    rig.bus.read()
    rig.bus.read()
    rig.guard.force_torque_off("again")
    assert not rig.bus.torque_on and not powered(rig)
    assert reason(rig) == "space bar, twice, then: again (torque is off)"
    assert rig.guard.stop_reason is not None and rig.guard.stop_reason.cause is StopCause.REQUESTED


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
        rig.guard.arm()
    assert rig.state() is GuardState.STOPPED and rig.bus.torque_on == powered(rig) == stuck
    assert reason(rig) == "port gone " + (
        "(torque could not be switched off: cut the power)" if stuck else "(torque is off)"
    )
    with refuses(GuardError):
        rig.guard.arm()


def test_a_refused_arming_with_torque_that_stays_on_is_latched_and_reported() -> None:
    rig = Rig(MockFault(FaultKind.HOT, 0, 99, servo=1, value=95.0), limits=GuardLimits(max_temperature=60.0))
    rig.bus._torque[:] = True  # of an earlier run

    def unconfirmed(on: bool) -> None:
        raise BusError("waist (id 3) did not confirm that torque is off. Cut the power by hand")

    rig.bus.torque = unconfirmed  # type: ignore[method-assign]
    with refuses(GuardError):
        rig.guard.arm()
    assert rig.state() is GuardState.STOPPED and powered(rig)
    shows(reason(rig))
