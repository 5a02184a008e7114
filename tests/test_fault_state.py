"""Faults of a running line: they begin, hurt devices, end; live ones count from when they are added."""

import pytest

from hardware.dynamixel import protocol2
from hardware.dynamixel.parsers import parser2
from sim.emulator import fault_state
from sim.emulator.fault_state import FaultState
from sim.emulator.faults import Direction, Fault, FaultKind
from stub_devices import StubDevice

PING = protocol2.ping(1)
STATUS = protocol2.status(1, 0, b"\x06\x04\x26")


def test_devices_are_hurt_once_and_healed_once() -> None:
    first, second = StubDevice(id=1), StubDevice(id=2)
    state = FaultState(
        [first, second],
        faults=[
            Fault(FaultKind.OVER_TEMPERATURE, ids=(1,), start=1.0, end=2.0, value=85.0),
            Fault(FaultKind.UNDER_VOLTAGE, start=3.0, end=4.0, value=4.0),
            Fault(FaultKind.OVERLOAD, ids=(2,), start=3.5, end=5.0),
        ],
    )
    for tenth in range(60):
        state.update(tenth / 10)
    assert first.handles == [("heat", 85.0), ("heat", None), ("supply", 4.0), ("supply", None)]
    assert second.handles == [("supply", 4.0), ("jam", True), ("supply", None), ("jam", False)]


def test_the_next_change_is_the_nearest_edge() -> None:
    state = FaultState([], faults=[Fault(FaultKind.SHORT, start=1.0, end=2.0)], origin=10.0)
    edges = []
    for now in (10.0, 11.0, 12.0):
        state.update(now)
        edges.append((state.dead, state.next_change))
    assert edges == [(False, 11.0), (True, 12.0), (False, None)]


def test_live_faults_count_from_now_and_are_cleared() -> None:
    state = FaultState([StubDevice(id=5)], origin=100.0)
    assert state.add(Fault(FaultKind.MISSING, ids=(5,), start=1.0, end=2.0), 200.0)
    seen = []
    for now in (200.5, 201.5, 202.5):
        state.update(now)
        seen.append(state.missing)
    assert seen == [frozenset(), {5}, frozenset()]
    state.add(Fault(FaultKind.ECHO), 203.0)
    state.add(Fault(FaultKind.SHORT), 203.0)
    state.clear(204.0, FaultKind.SHORT)
    assert (state.echo, state.dead) == (True, False)
    state.clear(204.0)
    assert state.active == ()


def test_there_is_a_most() -> None:
    state = FaultState([])
    added = [state.add(Fault(FaultKind.ECHO, start=9.0), 0.0) for _ in range(fault_state.MAX_FAULTS + 1)]
    assert added.count(False) == 1


def test_without_ids_all_are_meant() -> None:
    state = FaultState([StubDevice(id=1), StubDevice(id=2)], faults=[Fault(FaultKind.MISSING)])
    state.update(0.0)
    assert state.missing == {1, 2}


def test_directions_and_ids() -> None:
    drop = FaultKind.DROP
    state = FaultState([], faults=[Fault(drop, direction=Direction.TO_SERVOS)])
    state.update(0.0)
    assert (state.to_servos(PING), len(state.to_host(1, STATUS))) == ([], 1)
    state = FaultState([], faults=[Fault(drop, direction=Direction.TO_HOST, ids=(1,))])
    state.update(0.0)
    assert (len(state.to_servos(PING)), state.to_host(1, STATUS), len(state.to_host(2, STATUS))) == (1, [], 1)


@pytest.mark.parametrize("kind", [FaultKind.CRC_STORM, FaultKind.ID_CLASH, FaultKind.FLIP])
def test_spoilt_answers_are_of_no_use(kind: FaultKind) -> None:
    state = FaultState([StubDevice(id=1)], faults=[Fault(kind, ids=(1,))])
    state.update(0.0)
    (part,) = state.to_host(1, STATUS)
    assert len(part.data) == len(STATUS)
    assert parser2().feed(part.data) == []
    assert state.to_servos(PING)[0].data == PING


def test_devices_never_see_time_go_back() -> None:
    times: list[float] = []

    class Watch(StubDevice):
        def heat(self, celsius: float | None, now: float) -> None:
            times.append(now)

    state = FaultState([Watch()])
    state.update(5.0)
    state.add(Fault(FaultKind.OVER_TEMPERATURE), 4.0)
    state.clear(3.0)
    assert times == [5.0, 5.0]
