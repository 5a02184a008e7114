"""What the report says of the bus: its clock as it went, and every failure that somebody saw."""

import numpy as np
import pytest

from hardware.bus import ServoGoals, ServoStates
from hardware.errors import BusError
from hardware.guard_state import StopCause
from retarget.metrics import bus
from retarget.metrics.measure import measure
from retarget.pipeline import INTERRUPTED, Watch
from retarget.prepare import Prepared
from retarget.report import BusReport, ServoExtreme
from retarget.rotations import FloatArray
from retarget.run_result import RunResult
from rig import Rig, StubReconstructor, five, person, short_clip
from sim.mock_faults import FaultKind, MockFault
from support.messages import shows

TICKS = 51


def played(rig: Rig, watch: Watch | None = None) -> tuple[BusReport, RunResult]:
    human = person()
    stage = StubReconstructor(human)
    prepared = Prepared(short_clip(), human, five(), stage, rig.side, (), has_bus=True, notes=())
    run = prepared.run(watch)
    found = measure(run).bus
    assert found is not None
    return found, run


def still() -> FloatArray:
    return np.zeros((TICKS, 20))


def swing() -> FloatArray:
    script = still()
    script[:, 0] = 0.15 * (1.0 - np.cos(2.0 * np.pi * np.arange(TICKS) / (TICKS - 1)))
    return script


def test_the_rate_is_the_profiles_where_nothing_stalls() -> None:
    found, _ = played(Rig(still()))
    assert found.rate_hz == pytest.approx(125.0) and found.longest_period_ms == pytest.approx(8.0)


def test_the_hottest_servo_and_the_lowest_voltage_are_named() -> None:
    hot = MockFault(FaultKind.HOT, 20, 10, servo=3, value=61.5)
    low = MockFault(FaultKind.SUPPLY, 30, 1, servo=7, value=10.4)
    found, run = played(Rig(still(), faults=(hot, low)))
    assert run.robot is not None
    joints = run.robot.joint_map.joints
    assert found.hottest == ServoExtreme(joints[3], 61.5)
    assert found.lowest_voltage == ServoExtreme(joints[7], 10.4)
    assert found.retries == 0


def test_a_stall_of_the_bus_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, reads = Rig(still()), 0
    read = rig.bus.read

    def stalling() -> ServoStates:
        nonlocal reads
        reads += 1
        if reads == 20:
            rig.clock.advance(0.05)
        return read()

    monkeypatch.setattr(rig.bus, "read", stalling)
    found, _ = played(rig)
    assert found.rate_hz is not None and 50 / 0.5 < found.rate_hz < 120.0
    assert found.longest_period_ms == pytest.approx(58.0) and found.missed_ticks == 6


def test_what_was_not_measured_is_unknown() -> None:
    for times in (np.zeros(0), np.zeros(1), np.full(3, np.nan), np.zeros(3)):
        assert bus.tick_rate(times) is None
    assert bus.longest_period(np.full(3, np.nan)) is None
    assert bus.tick_rate(np.array([0.0, np.nan, 0.5])) == pytest.approx(2.0)
    times = np.array([0.0, 0.01, 0.024, 0.03, np.nan, 0.05, 0.06, 0.1])
    assert bus.missed_ticks(times, 0.01) == 4 and bus.missed_ticks(times[:1], 0.01) is None


def test_a_run_without_a_failure_has_no_faults() -> None:
    found, run = played(Rig(swing()))
    assert found.faults == 0 and run.stop is None


@pytest.mark.parametrize("first", [1, 2, 20])
def test_a_bus_that_dies_is_a_fault_though_its_tick_has_no_row(first: int) -> None:
    found, run = played(Rig(still(), faults=(MockFault(FaultKind.READ_FAILS, first=first, cycles=1000),)))
    assert (
        len(run.record) == first - 1 and run.stop is not None and run.stop.cause is StopCause.BUS
    )  # read cycle 0 was for arming
    assert found.faults == 1 and (found.rate_hz is None) is (first < 3)


def test_a_bus_that_dies_while_the_robot_brakes_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, asked = Rig(swing()), iter([False] * 15 + [True] * 1000)
    write = rig.bus.write

    def failing(goals: ServoGoals) -> None:
        if rig.guard.stop_reason is not None:
            raise BusError("the cable is out")
        write(goals)

    monkeypatch.setattr(rig.bus, "write", failing)
    found, run = played(rig, Watch(stop_asked=lambda: next(asked)))
    assert run.stop is not None and run.stop.cause is StopCause.REQUESTED
    assert run.reason is not None and INTERRUPTED in run.reason
    shows(run.reason)
    assert found.faults == 1


def test_a_person_who_insists_is_no_fault_of_the_bus() -> None:
    asked = iter([False] * 15 + [True] * 1000)
    found, run = played(Rig(swing()), Watch(stop_asked=lambda: next(asked), cut_asked=lambda: True))
    assert run.stop is not None and run.stop.then is StopCause.REQUESTED
    assert found.faults == 0


@pytest.mark.parametrize("script", [still(), swing()], ids=["stands", "brakes"])
def test_an_alarm_is_a_fault_with_and_without_a_row(script: FloatArray) -> None:
    fault = MockFault(FaultKind.ALERT, first=15, cycles=1, servo=4, alert=0x04)
    found, run = played(Rig(script, faults=(fault,)))
    assert run.stop is not None and run.stop.cause is StopCause.SERVO_ALERT and run.record.robot is not None
    assert found.faults == max(run.record.robot.faults.sum(), 1)
