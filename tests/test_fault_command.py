"""Faults typed in: they begin at once on the right bus, are listed, end; bad words are answered."""

import pytest

from sim.emulator.fault_command import obey
from sim.emulator.fault_state import FaultState
from sim.emulator.faults import FaultKind
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
