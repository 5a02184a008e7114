"""The report: its keys are a contract, its numbers are JSON, its file appears whole or not at all."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from retarget.pictures.outputs import report_path
from retarget.report.measure import measure
from retarget.report.report import Report, write_report
from rig import scripted_run

CONTRACT = [
    *("frames", "ticks", "duration_s", "rate_hz", "frames_per_s", "solve_us", "reconstruct_us", "retarget_us"),
    *("tracking_mm", "lag_s", "hand_path_ratio", "pelvis_excursion_ratio", "unsensed_mm", "min_clearance_mm"),
    *("penetrating_frames", "gated_frames", "limit_violations", "priority_violation_max"),
    *("com_outside_support_frames", "foot_slide_mm", "jerk_p95", "fallen", "mode_switches_per_s", "bus", "stop"),
]


@pytest.fixture(scope="module")
def report() -> Report:
    return measure(scripted_run())


def test_the_keys_of_the_contract_come_first_and_in_order(report: Report) -> None:
    data = json.loads(report.as_json())
    assert list(data)[: len(CONTRACT)] == CONTRACT
    assert set(data["solve_us"]) == {"p50", "p99", "max"}
    assert set(data["tracking_mm"]["l_hand"]) == {"mean", "p95", "max"}
    assert set(data["min_clearance_mm"]) == {"self", "scene", "ground"}
    assert set(data["limit_violations"]) == {"position", "velocity", "acceleration"}
    assert {"rate_hz", "cycle_ms", "faults"} <= set(data["bus"]) and {"p50", "p99"} <= set(data["bus"]["cycle_ms"])
    assert set(data["stop"]) == {"state", "reason"}


def test_numbers_that_are_not_finite_become_null(report: Report) -> None:
    data = json.loads(replace(report, lag_s=float("nan"), jerk_p95=float("inf")).as_json())
    assert data["lag_s"] is None and data["jerk_p95"] is None


def test_a_report_is_written_whole(report: Report, tmp_path: Path) -> None:
    path = report_path(tmp_path / "r.json")
    assert not path.exists()
    write_report(report, path)
    write_report(report, path)
    assert json.loads(path.read_text())["ticks"] == report.ticks
    assert [entry.name for entry in tmp_path.iterdir()] == ["r.json"]
