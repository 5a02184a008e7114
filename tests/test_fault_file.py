"""Fault files: read as written; all that is wrong said at once, with lines."""

import math
from pathlib import Path
from typing import get_args

import pytest

from retarget.errors import ConfigError
from sim.emulator.fault_file import FaultPlan, Kinds, load_fault_plan
from sim.emulator.faults import Direction, Fault, FaultKind, Unit

BUSES = {"left": [1, 2, 3], "right": [4, 5]}


def _load(tmp_path: Path, text: str) -> FaultPlan:
    path = tmp_path / "faults.yaml"
    path.write_text(text)
    return load_fault_plan(path, BUSES)


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
        unit=Unit.BYTES,
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


def test_the_file_knows_every_kind() -> None:
    assert set(get_args(Kinds)) == {kind.value for kind in FaultKind}


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
    said = [problem.render() for problem in caught.value.problems]
    assert [problem.line for problem in caught.value.problems] == [2, 3, 4, 4, 5, 6, 7, 8, 9]
    for line, words in zip(
        said,
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
        assert words in line, said
    assert "faults[2].ids" in "".join(said)


@pytest.mark.parametrize("text", ["faults: 3", "fault: []", "", "faults: [a]", "seed: -1\nfaults: []"])
def test_other_shapes_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(ConfigError):
        _load(tmp_path, text)
