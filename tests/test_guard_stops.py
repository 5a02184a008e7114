"""The guard stops whatever happens, along the braking trajectory if it can, and remembers why."""

from collections.abc import Callable

import numpy as np
import pytest

from guard_rig import DT, MAP, Rig
from hardware.arrays import FloatArray
from hardware.bus import ServoAlert, ServoStates
from hardware.errors import GuardError
from hardware.guard import Halt, Think
from hardware.guard_state import GuardLimits, GuardState, StopCause
from sim.mock_faults import FaultKind, MockFault
from support.messages import refuses, shows


def failing(error: Exception, after: int) -> Callable[[Rig], Think]:
    def build(rig: Rig) -> Think:
        count = 0

        def think(states: ServoStates) -> FloatArray:
            nonlocal count
            count += 1
            if count > after:
                raise error
            return rig.faster(states)

        return think

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


def test_a_stop_asked_for_while_thinking_sends_no_goal() -> None:
    rig = Rig()
    rig.guard.arm()
    rig.run(20)

    def think(states: ServoStates) -> FloatArray:
        rig.guard.stop("enough")
        return rig.faster(states)

    speed = abs(rig.gate.velocity[0])
    rig.run(1, think)
    assert abs(rig.gate.velocity[0]) < speed


@pytest.mark.parametrize(
    ("think", "cause"),
    [
        (failing(ValueError("no such sensor"), 20), StopCause.SOURCE),
        (failing(ZeroDivisionError(), 20), StopCause.SOURCE),
    ],
)
def test_an_exception_while_thinking_brakes_in_the_same_tick(think: Callable[[Rig], Think], cause: StopCause) -> None:
    rig = Rig()
    rig.guard.arm()
    rig.run(100, think(rig))
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


def test_when_not_even_torque_goes_off_a_person_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_a_stop_goes_along_the_callers_way() -> None:
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


@pytest.mark.parametrize("way", ["faster than the filter lets", "not finite", "none", "fails"])
def test_where_there_is_no_good_way_the_filter_brakes(way: str) -> None:
    rig = Rig(limits=GuardLimits(max_home_ticks=0))
    rig.guard.arm()
    rig.run(20)
    rig.guard.stop("space bar")

    def halt() -> FloatArray | None:
        if way == "fails":
            raise ArithmeticError("no way")
        return None if way == "none" else rig.gate.position if way.startswith("faster") else np.full(4, np.nan)

    ticks = 0
    while rig.guard.active:
        tick(rig, halt)
        ticks += 1
    assert 3 < ticks < 30
    assert rig.state() is GuardState.STOPPED and rig.gate.at_rest and rig.bus.torque_on
    assert rig.guard.stop_reason is not None and rig.guard.stop_reason.reason == "space bar"
    rig.check_goals()


def test_a_filter_that_cannot_judge_the_way_still_brakes(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = moving()
    monkeypatch.setattr(rig.gate, "admit", lambda goal: 1 // 0)
    while rig.guard.active:
        tick(rig, lambda: rig.gate.position)
    assert rig.guard.stop_reason is not None and rig.guard.stop_reason.cause is StopCause.FILTER
    assert rig.gate.at_rest and rig.bus.torque_on
    rig.check_goals()


def test_a_way_that_fails_at_the_ordinary_end_is_said() -> None:
    rig = moving()
    rig.guard.rest()

    def halt() -> FloatArray:
        raise ArithmeticError("no way")

    while rig.state() is GuardState.STOPPING:
        tick(rig, halt)
    assert rig.state() is GuardState.STOPPED
    assert rig.guard.stop_reason is not None and rig.guard.stop_reason.reason == "no way"
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
