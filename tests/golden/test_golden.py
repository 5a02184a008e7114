"""Golden runs: what is compared and how, and a few runs against stored values, which every machine finds."""

import json
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.golden import wire_tap
from benchmarks.golden.compare import (
    COUNTED_MESSAGES,
    MESSAGES,
    TIMINGS,
    Difference,
    array_difference,
    compared_report,
    differences,
    wire_difference,
)
from benchmarks.golden.matrix import FAULT_ROWS
from benchmarks.golden.play import Arrays, Outcome
from benchmarks.golden.stored import STORED, hashes_of_runs
from benchmarks.golden.tree import this_tree


def outcome(**arrays: Any) -> Outcome:
    report = {"ticks": 3, "solve_us": {"p50": 1.0}, "stop": {"state": "idle", "reason": None}, "notes": []}
    wire = {"time": [0.0, 0.1], "port": [0, 0], "direction": [0, 1], "size": [2, 3]}
    made = {name: np.array(values) for name, values in wire.items()}
    made["data"] = np.arange(5, dtype=np.uint8)
    return Outcome(0, {"time": np.arange(3.0), "goal_ticks": np.zeros((3, 2), dtype=np.int64)} | arrays, report, made)


def whats(found: Iterable[Difference]) -> list[str]:
    return [one.what for one in found]


def test_the_same_is_equal() -> None:
    assert not differences(outcome(), outcome())


def test_a_changed_array_is_found_with_its_first_tick_and_by_how_much() -> None:
    ticks = np.zeros((3, 2), dtype=np.int64)
    ticks[1, 1], ticks[2, 0] = 4, -7
    found = differences(outcome(goal_ticks=ticks), outcome())
    assert whats(found) == ["goal_ticks"] and found[0].first == 1
    assert "2 of 3 rows" in found[0].text and "7" in found[0].text


@pytest.mark.parametrize(
    ("ours", "theirs", "first"),
    [
        ([1.0, 0.0], [1.0, -0.0], 1),
        ([1.0, np.nan], [1.0, 0.0], 1),
        ([1.0, 2.0], [1.0, np.nextafter(2.0, 3.0)], 1),
        ([True, False], [True, True], 1),
        (["a", "b"], ["c", "b"], 0),
        ([1.0, 2.0, 3.0], [1.0, 2.0], 2),
        ([1, 2], [1.0, 2.0], None),
        ([[1.0], [2.0]], [[1.0, 1.0], [2.0, 2.0]], None),
        (1.0, 2.0, None),
        ("body", "bodies", None),
    ],
)
def test_one_bit_is_a_difference(ours: Any, theirs: Any, first: int | None) -> None:
    found = array_difference("x", np.array(ours), np.array(theirs))
    assert found is not None and found.first == first
    assert array_difference("x", np.array(theirs), np.array(theirs)) is None


def test_a_nan_is_the_same_nan() -> None:
    assert array_difference("x", np.array([np.nan, 1.0]), np.array([np.nan, 1.0])) is None


def test_the_first_message_on_the_wire_that_differs() -> None:
    ours, theirs = outcome().wire, outcome().wire
    assert wire_difference(ours, theirs) is None
    theirs["data"][2] += 1
    found = wire_difference(ours, theirs)
    assert found is not None and "02 03 04" in found.text and "03 03 04" in found.text
    later: Arrays = outcome().wire
    later["time"][0] += 0.01
    found = wire_difference(ours, later)
    assert found is not None and "message 0" in found.text
    shorter = {name: values[:1] for name, values in ours.items()} | {"data": ours["data"][:2]}
    found = wire_difference(ours, shorter)
    assert found is not None and "2 here, 1 there" in found.text
    assert wire_difference(ours, {name: values[:0] for name, values in ours.items()}) is not None


def test_timings_and_wording_are_left_out_and_nothing_else() -> None:
    report = {
        "ticks": 3,
        "stop": {"state": "stopped", "reason": "too hot"},
        "bus": {"faults": 0, "cycle_ms": {"p50": 0.1}},
        "live": {"dropped": {"one reason": 3, "another": 1}},
        "physics": None,
    }
    assert compared_report(report) == {
        "ticks": 3,
        "stop.state": "stopped",
        "stop.reason": True,
        "bus.faults": 0,
        "live.dropped": [1, 3],
        "physics": None,
    }
    assert all([*TIMINGS.values(), *MESSAGES.values(), *COUNTED_MESSAGES.values()])


def test_a_fault_row_of_every_kind_is_run() -> None:
    from sim.faults.rows import ROWS

    kinds = {row.reaction for row in ROWS if row.name in FAULT_ROWS}
    assert kinds == {row.reaction for row in ROWS if not row.alone}


def test_bytes_of_several_ports_are_kept_in_order() -> None:
    class Port:
        def __init__(self) -> None:
            self.waiting, self.time = b"", 0.0

        def now(self) -> float:
            return self.time

        def write(self, data: bytes) -> None:
            self.waiting, self.time = data[::-1], self.time + 1.0

        def read(self) -> bytes:
            data, self.waiting = self.waiting, b""
            return data

    log = wire_tap.Log()
    wire_tap.tap(Port, log)
    first, second = Port(), Port()
    first.write(b"abc")
    second.write(b"x")
    assert first.read() == b"cba" and first.read() == b""
    found = log.arrays()
    assert found["data"].tobytes() == b"abcxcba"
    assert [found[name].tolist() for name in ("port", "direction", "size", "time")] == [
        [0, 1, 0],
        [0, 0, 1],
        [3, 1, 3],
        [0.0, 0.0, 1.0],
    ]


def test_the_command_refuses_without_a_commit(root: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.golden"], cwd=root, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 2 and "--against" in done.stderr


def test_runs_are_the_stored_ones(root: Path, tmp_path: Path) -> None:
    """`make golden-store` renews what is stored."""
    if not (root / ".git").exists():
        pytest.skip("not a git checkout")
    stored = json.loads(STORED.read_text(encoding="utf-8"))
    found = hashes_of_runs(this_tree(root), tmp_path)
    differ = [
        f"{run}: {name}"
        for run, values in stored.items()
        for name in sorted(values.keys() | found.get(run, {}).keys())
        if values.get(name) != found.get(run, {}).get(name)
    ]
    assert not differ and set(found) == set(stored)
