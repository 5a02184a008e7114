"""The report of the last seconds of a run."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from live_rig import LiveRig
from retarget.cli import follow_clip
from retarget.cli.boundary import STOPPED
from retarget.cli.outputs import Outputs
from retarget.live.begin import LiveOptions
from retarget.metrics.latest import latest_of, measure_latest
from retarget.metrics.measure import measure
from retarget.pipeline import Watch
from retarget.run_result import RunResult
from rig import scripted_run
from sim.faults.sender import FakeSender


@pytest.fixture(scope="module")
def run() -> RunResult:
    """Asked to end in motion."""
    ticks = iter(range(10_000))
    with LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=8.0)).prepared() as prepared:
        return prepared.run(Watch(stop_asked=lambda: next(ticks) > 700))


def test_its_rows_are_those_of_the_end(run: RunResult) -> None:
    last = latest_of(run, 4.0)
    assert len(last.record) == 500 and last.ticks_followed < run.ticks_followed
    for name in ("sensors_asked", "sensors_reached", "landmarks_reached"):
        np.testing.assert_array_equal(getattr(last, name), getattr(run, name)[-500:])
    whole, sent = run.record.robot, last.record.robot
    assert whole is not None and sent is not None and run.robot is not None
    np.testing.assert_array_equal(sent.start, whole.q[-501, run.robot.servo_columns])


def test_it_tells_of_the_whole_what_costs_little(run: RunResult) -> None:
    last, whole, part = measure_latest(run, 4.0), measure(run), measure(latest_of(run, 4.0))
    assert (last.ticks, last.frames, last.duration_s) == (whole.ticks, whole.frames, whole.duration_s)
    assert last.limit_violations == whole.limit_violations and last.bus == whole.bus and last.stop == whole.stop
    assert last.sensors_mm == part.sensors_mm != whole.sensors_mm
    assert last.min_clearance_mm == part.min_clearance_mm and last.foot_slide_mm == part.foot_slide_mm
    assert any("last 4 s" in note and "--report" in note for note in last.notes)


def test_after_the_end_of_following_nothing_is_asked(run: RunResult) -> None:
    last = latest_of(run, 0.5)
    assert last.ticks_followed == 0 and measure(last).tracking_mm == {}


def test_a_short_one_is_told_whole() -> None:
    run = scripted_run()
    assert latest_of(run, 10.0) is run and measure_latest(run, 10.0) == measure(run)


def test_who_asked_a_run_to_end_waits_for_its_end_only(
    run: RunResult, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(follow_clip, "measure_latest", lambda run: measure_latest(run, 4.0))
    said: list[tuple[str, ...]] = []
    monkeypatch.setattr(follow_clip, "_tell", lambda report, written: said.append(report.notes))
    assert follow_clip.finished(run, Outputs()) == STOPPED
    follow_clip.finished(replace(run, stop=None), Outputs())
    assert ["last 4 s" in " ".join(notes) for notes in said] == [True, False]


def test_a_file_is_of_the_whole_run(run: RunResult, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    said: list[tuple[str, ...]] = []
    monkeypatch.setattr(follow_clip, "_tell", lambda report, written: said.append(report.notes))
    monkeypatch.setattr(follow_clip, "measure_latest", lambda run: pytest.fail("not the whole"))
    follow_clip.finished(run, Outputs(report=tmp_path / "report.json"))
    assert "last" not in " ".join(said[0])
