"""Faults of an emulated line: as data, on the bytes of a packet, over time, from a file and from a keyboard."""

import math
import random
from pathlib import Path
from unittest.mock import Mock, call

import pytest

from emulated import PING, STATUS, numbered
from messages import shows
from retarget.errors import ConfigError
from sim.emulator import fault_state
from sim.emulator.device import Device
from sim.emulator.fault_state import FaultPlan, FaultState, load_fault_plan, obey
from sim.emulator.faults import MEASURED_KINDS, DelayedBytes, Direction, Fault, FaultKind, Unit, mangled, random_faults

PACKET = bytes(range(40))


def test_windows_of_time_and_cycles_begin_inside_and_end_outside() -> None:
    fault = Fault(FaultKind.SHORT, start=1.0, end=2.0, from_cycle=3, to_cycle=5)
    assert [fault.lasts(time, 3) for time in (0.9, 1.0, 1.9, 2.0)] == [False, True, True, False]
    assert [fault.lasts(1.5, cycle) for cycle in (2, 3, 4, 5)] == [False, True, True, False]
    assert Fault(FaultKind.SHORT).lasts(math.nextafter(math.inf, 0.0), 10**9)


def test_a_plan_follows_from_its_seed() -> None:
    plans = [random_faults(seed, range(1, 21), 60.0) for seed in range(50)]
    assert plans == [random_faults(seed, range(1, 21), 60.0) for seed in range(50)]
    assert len(set(plans)) == 50
    faults = [fault for plan in plans for fault in plan]
    assert {fault.kind for fault in faults} == set(FaultKind) - MEASURED_KINDS
    for fault in faults:
        assert 0.0 <= fault.start <= fault.end <= 60.0 and fault.end - fault.start <= 12.0
        assert set(fault.ids) <= set(range(1, 21))


def _mangled(fault: Fault, packet: bytes = PACKET, seed: int = 1) -> bytes:
    return b"".join(part.data for part in mangled(packet, [fault], random.Random(seed)))


def _bits(first: bytes, second: bytes) -> int:
    return sum((a ^ b).bit_count() for a, b in zip(first, second, strict=True))


def test_faults_of_packets() -> None:
    assert mangled(PACKET, [Fault(FaultKind.DROP)], random.Random(1)) == []
    assert _bits(_mangled(Fault(FaultKind.FLIP)), PACKET) == 1
    assert _mangled(Fault(FaultKind.DUPLICATE)) == PACKET + PACKET
    assert mangled(PACKET, [Fault(FaultKind.LATE, value=0.5)], random.Random(1)) == [DelayedBytes(0.5, PACKET)]
    noisy = _mangled(Fault(FaultKind.NOISE, value=6.0))
    assert noisy.endswith(PACKET) and 1 <= len(noisy) - len(PACKET) <= 6
    storm = Fault(FaultKind.CRC_STORM)
    for storms in ([storm], [storm, storm]):  # two leave a packet as wrong as one
        (spoilt,) = mangled(PACKET, storms, random.Random(0))
        assert spoilt.data == PACKET[:-1] + bytes((PACKET[-1] ^ 0xFF,))
    for both in ([storm, Fault(FaultKind.DUPLICATE)], [Fault(FaultKind.DUPLICATE), storm]):
        (doubled,) = mangled(PACKET, both, random.Random(0))
        assert doubled.data == 2 * spoilt.data
    several = [Fault(FaultKind.LATE, value=0.5), Fault(FaultKind.DUPLICATE), Fault(FaultKind.LATE, value=0.25)]
    assert mangled(b"ab", several, random.Random(1)) == [DelayedBytes(0.75, b"abab")]


def test_faults_of_bytes() -> None:
    assert _mangled(Fault(FaultKind.DROP, of=Unit.BYTES)) == b""
    assert _bits(_mangled(Fault(FaultKind.FLIP, of=Unit.BYTES)), PACKET) == len(PACKET)
    assert _mangled(Fault(FaultKind.DUPLICATE, of=Unit.BYTES)) == bytes(byte for byte in PACKET for _ in range(2))
    late = mangled(PACKET[:3], [Fault(FaultKind.LATE, of=Unit.BYTES, value=0.5)], random.Random(1))
    assert late == [DelayedBytes(0.5, PACKET[:1]), DelayedBytes(0.5, PACKET[1:2]), DelayedBytes(0.5, PACKET[2:3])]
    assert len(_mangled(Fault(FaultKind.NOISE, of=Unit.BYTES))) > len(PACKET)
    some = Fault(FaultKind.FLIP, rate=0.3, of=Unit.BYTES)
    assert _mangled(some, seed=5) == _mangled(some, seed=5) != _mangled(some, seed=6)


def test_faults_of_devices_begin_once_and_end_once() -> None:
    first, second = (Mock(spec=Device, id=number) for number in (1, 2))
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
    low, usual = call.supply(4.0, 3.0), call.supply(None, 4.0)
    assert first.mock_calls == [call.heat(85.0, 1.0), call.heat(None, 2.0), low, usual]
    assert second.mock_calls == [low, call.jam(True, 3.5), usual, call.jam(False, 5.0)]
    state.add(Fault(FaultKind.OVER_TEMPERATURE, ids=(1,)), 4.0)
    state.clear(3.0)
    assert [one.args[1] for one in first.heat.call_args_list[2:]] == [5.9, 5.9], "time never goes back"


def test_faults_that_are_added_count_from_then_up_to_a_most_and_without_ids_all_are_meant() -> None:
    state = FaultState([numbered(5), numbered(6)], origin=100.0)
    assert state.add(Fault(FaultKind.MISSING, start=1.0, end=2.0), 200.0)
    seen = []
    for now in (200.5, 201.5, 202.5):
        state.update(now)
        seen.append(state.missing)
    assert seen == [frozenset(), {5, 6}, frozenset()]
    added = [state.add(Fault(FaultKind.ECHO, start=9.0), 203.0) for _ in range(fault_state.MAX_FAULTS)]
    assert added.count(False) == 1


def test_directions_and_ids() -> None:
    drop = FaultKind.DROP
    state = FaultState([], faults=[Fault(drop, direction=Direction.TO_SERVOS)])
    state.update(0.0)
    assert (state.to_servos(PING), len(state.to_host(1, STATUS))) == ([], 1)
    state = FaultState([], faults=[Fault(drop, direction=Direction.TO_HOST, ids=(1,))])
    state.update(0.0)
    assert (len(state.to_servos(PING)), state.to_host(1, STATUS), len(state.to_host(2, STATUS))) == (1, [], 1)


# Files.


def _load(tmp_path: Path, text: str) -> FaultPlan:
    path = tmp_path / "faults.yaml"
    path.write_text(text)
    return load_fault_plan(path, {"left": [1, 2, 3], "right": [4, 5]})


def test_a_file_has_every_kind_and_key(tmp_path: Path) -> None:
    for kind in FaultKind:
        assert _load(tmp_path, f"faults: [{{fault: {kind.value}}}]") == FaultPlan(faults=(Fault(kind),))
    text = """
seed: 7
faults:
  - {fault: drop, ids: [5], rate: 0.5, of: bytes, direction: to_host, from_cycle: 2, to_cycle: 4, bus: right}
  - {fault: under_voltage, start: 1, end: 2.5, value: 6.1}
"""
    where = {"ids": (5,), "direction": Direction.TO_HOST, "bus": "right"}
    drop = Fault(FaultKind.DROP, rate=0.5, of=Unit.BYTES, from_cycle=2, to_cycle=4, **where)
    sag = Fault(FaultKind.UNDER_VOLTAGE, start=1.0, end=2.5, value=6.1)
    plan = _load(tmp_path, text)
    assert plan == FaultPlan(faults=(drop, sag), seed=7)
    assert (plan.of_bus("left"), plan.of_bus("right")) == ((sag,), (drop, sag))
    assert sag.end == 2.5 and drop.end == math.inf


def test_all_problems_at_once_with_line_and_key(tmp_path: Path) -> None:
    text = """faults:
  - {fault: mising}
  - {fault: flip, rate: 2}
  - {fault: missing, ids: [9], rate: 0.5}
  - {fault: short, start: 2, end: 1}
  - {fault: over_temperature, value: 900}
  - {fault: echo, bus: rihgt}
  - {fault: drop, from_cycle: 3, to_cycle: 3}
  - {fault: drop, when: 3}
"""
    with pytest.raises(ConfigError) as caught:
        _load(tmp_path, text)
    assert [problem.line for problem in caught.value.problems] == [2, 3, 4, 4, 5, 6, 7, 8, 9]
    shows([problem.render() for problem in caught.value.problems], "missing", 9, "faults[2].ids")


# Typed faults.

BUSES = {"left": [1, 2], "right": [5]}


@pytest.fixture
def states() -> dict[str, FaultState]:
    return {name: FaultState([*map(numbered, ids)]) for name, ids in BUSES.items()}


def _obey(line: str, states: dict[str, FaultState], now: float = 10.0) -> str:
    return obey(line, states, BUSES, lambda: now)


def test_a_typed_fault_begins_where_its_ids_are_and_is_cleared(states: dict[str, FaultState]) -> None:
    assert _obey("missing 5", states) == "missing 5: begun"
    assert (states["left"].missing, states["right"].missing) == (frozenset(), frozenset({5}))
    assert _obey("list", states) == "right: missing 5"
    assert _obey("clear", states) == "cleared all faults"
    assert _obey("list", states) == "no fault"
    for line in ("echo", "short", "clear echo"):
        _obey(line, states)
    assert [fault.kind for fault in states["left"].active] == [FaultKind.SHORT]


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        ("", ""),
        ("mising 5", "Did you mean missing?"),
        ("missing 77", "no such device"),
        ("missing five", "wrong value"),
        ("flip rat=1", "Did you mean rate?"),
        ("flip rate=lots", "wrong value"),
        ("flip rate=[", "not valid YAML"),
        ("short 1", "short has no such key"),
        ("clear everything", "unknown fault"),
        ("missing \u0665", "wrong value"),
        ("help", "Names: drop"),
        ("x" * 5000, "unknown fault"),
    ],
)
def test_bad_words_change_nothing_and_have_a_reason(states: dict[str, FaultState], line: str, answer: str) -> None:
    assert answer in _obey(line, states)
    assert all(state.active == () for state in states.values())
