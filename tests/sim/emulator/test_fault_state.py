"""Faults of a running line: they begin, disturb devices, end; added ones count from when they are added."""

import math
from pathlib import Path

import pytest

from hardware.dynamixel.codec import protocol2
from retarget.errors import ConfigError
from sim.emulator import fault_state
from sim.emulator.fault_state import FaultPlan, FaultState, load_fault_plan, obey
from sim.emulator.faults import Direction, Fault, FaultKind, Unit
from stub_devices import StubDevice

BUSES = {"left": [1, 2], "right": [5]}


@pytest.fixture
def states() -> dict[str, FaultState]:
    return {name: FaultState([StubDevice(id=device) for device in ids]) for name, ids in BUSES.items()}


def _obey(line: str, states: dict[str, FaultState], now: float = 10.0) -> str:
    return obey(line, states, BUSES, lambda: now)


def test_a_fault_begins_where_its_ids_are(states: dict[str, FaultState]) -> None:
    assert _obey("missing 5", states) == "missing 5: begun"
    assert (states["left"].missing, states["right"].missing) == (frozenset(), frozenset({5}))
    assert _obey("list", states) == "right: missing 5"
    assert _obey("clear", states) == "cleared all faults"
    assert _obey("list", states) == "no fault"


def test_keys_and_times_from_now(states: dict[str, FaultState]) -> None:
    assert "begun" in _obey("flip rate=0.01 of=bytes end=2 bus=left", states)
    (fault,) = states["left"].active
    assert (fault.rate, fault.start, fault.end) == (0.01, 10.0, 12.0)
    assert states["right"].active == ()
    states["left"].update(12.0)
    assert states["left"].active == ()


def test_one_kind_is_cleared(states: dict[str, FaultState]) -> None:
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
def test_bad_words_change_nothing_and_say_why(states: dict[str, FaultState], line: str, answer: str) -> None:
    assert answer in _obey(line, states)
    assert all(state.active == () for state in states.values())


FAULT_FILE_BUSES = {"left": [1, 2, 3], "right": [4, 5]}


def _load(tmp_path: Path, text: str) -> FaultPlan:
    path = tmp_path / "faults.yaml"
    path.write_text(text)
    return load_fault_plan(path, FAULT_FILE_BUSES)


def test_corrupting_one_packet_in_a_hundred_is_one_line(tmp_path: Path) -> None:
    plan = _load(tmp_path, "faults:\n  - {fault: flip, rate: 0.01}\n")
    assert plan == FaultPlan((Fault(FaultKind.FLIP, rate=0.01),), 0)


def test_everything_that_can_be_said(tmp_path: Path) -> None:
    text = """
seed: 7
faults:
  - {fault: drop, ids: [5], rate: 0.5, of: bytes, direction: to_host, from_cycle: 2, to_cycle: 4, bus: right}
  - {fault: under_voltage, start: 1, end: 2.5, value: 6.1}
"""
    drop = Fault(
        FaultKind.DROP,
        ids=(5,),
        rate=0.5,
        of=Unit.BYTES,
        direction=Direction.TO_HOST,
        from_cycle=2,
        to_cycle=4,
        bus="right",
    )
    sag = Fault(FaultKind.UNDER_VOLTAGE, start=1.0, end=2.5, value=6.1)
    plan = _load(tmp_path, text)
    assert plan == FaultPlan((drop, sag), 7)
    assert (plan.of_bus("left"), plan.of_bus("right")) == ((sag,), (drop, sag))
    assert sag.end == 2.5 and drop.end == math.inf


@pytest.mark.parametrize("kind", FaultKind)
def test_every_kind_is_one_word(tmp_path: Path, kind: FaultKind) -> None:
    assert _load(tmp_path, f"faults: [{{fault: {kind.value}}}]").faults == (Fault(kind),)


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
    replies = [problem.render() for problem in caught.value.problems]
    assert [problem.line for problem in caught.value.problems] == [2, 3, 4, 4, 5, 6, 7, 8, 9]
    for line, words in zip(
        replies,
        (
            "Did you mean missing",
            "rate",
            "no such key",
            "no such device; found 9; allowed: 1, 2, 3, 4, 5",
            "ends before it begins; found 1; allowed: above 2",
            "-40 to 200",
            "Did you mean right",
            "allowed: above 3",
            "unknown key",
        ),
        strict=True,
    ):
        assert words in line, replies
    assert "faults[2].ids" in "".join(replies)


@pytest.mark.parametrize("text", ["faults: 3", "fault: []", "", "faults: [a]", "seed: -1\nfaults: []"])
def test_other_shapes_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(ConfigError):
        _load(tmp_path, text)


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
    assert protocol2.parser().feed(part.data) == []
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
