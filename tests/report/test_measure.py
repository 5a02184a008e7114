"""The report of a finished run: the bus's clock as it went, every failure, and the last seconds alone."""

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.physics_runs import play, stood
from faulty_bus import FaultKind, MockFault
from hardware.bus import ServoGoals, ServoStates
from hardware.clock import VirtualClock
from hardware.errors import BusError
from hardware.guard_state import StopCause
from live_rig import LiveRig
from messages import shows
from operators import ENOUGH, Asks
from retarget.cli import run as follow_clip
from retarget.human.samples import Playback
from retarget.live.begin import LiveOptions
from retarget.pictures.outputs import Outputs
from retarget.report import measure as bus
from retarget.report.findings import findings
from retarget.report.measure import latest_of, measure, measure_latest
from retarget.report.report import BusReport, ServoExtreme
from retarget.run.loop import Operator
from retarget.run.options import RunOptions
from retarget.run.prepare import Prepared, prepare
from retarget.run.run_result import RunResult
from retarget.types import FloatArray
from rig import Rig, StubReconstructor, five, person, short_clip
from sim.faults.sender import FakeSender
from sim.mock_bus import mock_bus
from sim.performer import synthetic_performer


def played(rig: Rig, operator: Operator | None = None) -> tuple[BusReport, RunResult]:
    human = person()
    stage = StubReconstructor(human)
    prepared = Prepared(short_clip(), human, five(), stage, rig.machine, (), has_bus=True, notes=(), clock=rig.clock)
    run = prepared.run(operator)
    found = measure(run).bus
    assert found is not None
    return found, run


STILL = np.zeros((51, 20))
SWING = STILL + 0.15 * (1.0 - np.cos(2.0 * np.pi * np.arange(51) / 50.0))[:, None] * (np.arange(20) == 0)


def test_the_hottest_servo_and_the_lowest_voltage_are_named() -> None:
    hot = MockFault(FaultKind.HOT, 20, 10, servo=3, value=61.5)
    low = MockFault(FaultKind.SUPPLY, 30, 1, servo=7, value=10.4)
    found, run = played(Rig(STILL, faults=(hot, low)))
    assert run.robot is not None
    joints = run.robot.joint_map.joints
    assert found.hottest == ServoExtreme(joints[3], 61.5)
    assert found.lowest_voltage == ServoExtreme(joints[7], 10.4)
    assert found.retries == 0


def test_a_stall_of_the_bus_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(STILL)
    read = rig.bus.read

    def stalling() -> ServoStates:
        rig.clock.advance(0.05 if len(rig.bus.read_at) == 19 else 0.0)
        return read()

    monkeypatch.setattr(rig.bus, "read", stalling)
    found, _ = played(rig)
    assert found.rate_hz is not None and 50 / 0.5 < found.rate_hz < 124.0
    assert found.longest_period_ms == pytest.approx(58.0) and found.missed_ticks == 6


def test_what_was_not_measured_is_unknown() -> None:
    for times in (np.zeros(0), np.zeros(1), np.full(3, np.nan), np.zeros(3)):
        assert bus.pace(times, 0.01) is None
    assert bus.pace(np.array([0.0, np.nan, 0.5]), 0.5) == (2.0, 0.5, 0)
    times = np.array([0.0, 0.01, 0.024, 0.03, np.nan, 0.05, 0.06, 0.1])
    found = bus.pace(times, 0.01)
    assert found is not None and found[2] == 4
    np.testing.assert_allclose(found[:2], (60.0, 0.04))


@pytest.mark.parametrize("first", [1, 2, 20])
def test_a_bus_that_dies_is_a_fault_though_its_tick_has_no_row(first: int) -> None:
    found, run = played(Rig(STILL, faults=(MockFault(FaultKind.READ_FAILS, first=first, cycles=1000),)))
    assert len(run.record) == first - 1  # read cycle 0 was for arming
    assert run.stop is not None and run.stop.cause is StopCause.BUS
    assert found.faults == 1 and (found.rate_hz is None) is (first < 3)


def test_a_bus_that_dies_while_the_robot_brakes_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, asked = Rig(SWING), iter([False] * 15 + [True] * 1000)
    write = rig.bus.write

    def failing(goals: ServoGoals) -> None:
        if rig.guard.stop is not None:
            raise BusError("the cable is out")
        write(goals)

    monkeypatch.setattr(rig.bus, "write", failing)
    found, run = played(rig, Asks(lambda: next(asked)))
    assert run.stop is not None and run.stop.cause is StopCause.REQUESTED
    shows(run.reason, ENOUGH)
    assert found.faults == 1


@pytest.mark.parametrize("script", [STILL, SWING], ids=["stands", "brakes"])
def test_an_alarm_is_a_fault_with_and_without_a_row(script: FloatArray) -> None:
    fault = MockFault(FaultKind.ALERT, first=15, cycles=1, servo=4, alert=0x04)
    found, run = played(Rig(script, faults=(fault,)))
    assert run.stop is not None and run.stop.cause is StopCause.SERVO_ALERT
    assert found.faults == max(run.record.faults.sum(), 1)


@pytest.fixture(scope="module")
def run() -> RunResult:
    """Asked to end in motion."""
    ticks = iter(range(10_000))
    with LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=8.0)).prepared() as prepared:
        return prepared.run(Asks(lambda: next(ticks) > 700))


def test_its_rows_are_those_of_the_end(run: RunResult) -> None:
    last = latest_of(run, 4.0)
    assert len(last.record) == 500 and last.ticks_followed < run.ticks_followed
    for name in ("sensors_desired", "sensors_reached", "landmarks_reached"):
        np.testing.assert_array_equal(getattr(last, name), getattr(run, name)[-500:])
    assert run.robot is not None
    np.testing.assert_array_equal(last.record.start, run.record.q[-501, run.robot.servo_columns])


def test_it_measures_on_the_whole_run_what_costs_little(run: RunResult) -> None:
    last, whole, part = measure_latest(run, 4.0), measure(run), measure(latest_of(run, 4.0))
    assert (last.ticks, last.frames, last.duration_s) == (whole.ticks, whole.frames, whole.duration_s)
    assert last.limit_violations == whole.limit_violations and last.bus == whole.bus and last.stop == whole.stop
    assert last.sensors_mm == part.sensors_mm != whole.sensors_mm
    assert last.min_clearance_mm == part.min_clearance_mm and last.foot_slide_mm == part.foot_slide_mm
    assert any("last 4 s" in note and "--report" in note for note in last.notes)


def test_a_file_is_of_the_whole_run(run: RunResult, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    said: list[tuple[str, ...]] = []
    monkeypatch.setattr(follow_clip, "show_summary", lambda run, report, *_, **more: said.append(report.notes))
    monkeypatch.setattr(follow_clip, "measure_latest", lambda run: pytest.fail("not the whole"))
    follow_clip.finished(run, Outputs(report=tmp_path / "report.json"))
    assert "last" not in " ".join(said[0])


# A long run: what is measured of it needs little memory, and is the same in blocks of any size.


def longer(run: RunResult, rows: int) -> RunResult:
    """The run, as slow as fills so many rows."""
    frames, of = run.clip.frames, np.arange(rows) * len(run.record) // rows
    record = run.record.each(lambda array: np.ascontiguousarray(array[of]))
    ticks = record.following.stop - record.following.start
    at = np.arange(ticks) * len(frames) // ticks
    clip = replace(run.clip, frames=frames.at_rows(at, np.arange(ticks) / run.clip.rate_hz), ticks=ticks, lap=0)
    return replace(run, record=record, clip=clip)


@pytest.fixture(scope="module")
def clip_run() -> RunResult:
    options = RunOptions(robot="op3", playback=Playback(end=1.0))
    with prepare(synthetic_performer, options, clock=VirtualClock(), make_bus=mock_bus) as prepared:
        return prepared.run()


def peak_of_summary(run: RunResult) -> int:
    """Most bytes that the summary of a run needs beside the run."""
    tracemalloc.start()
    try:
        findings(run, measure(run))
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_the_summary_of_a_long_run_needs_less_memory_than_the_run(clip_run: RunResult) -> None:
    few, many = 1500, 4500
    a_row = (peak_of_summary(longer(clip_run, many)) - peak_of_summary(longer(clip_run, few))) / (many - few)
    assert a_row < 1000.0, f"{a_row:.0f} bytes a row; a row of the run has 3300"


def test_blocks_of_any_size_give_the_same_figures(clip_run: RunResult, monkeypatch: pytest.MonkeyPatch) -> None:
    report = measure(clip_run)
    for block in (7, len(clip_run.record) + 1):
        monkeypatch.setattr("retarget.report.motion_metrics.BLOCK", block)
        again = measure(clip_run)
        assert again.lag_s == pytest.approx(report.lag_s, rel=1e-9)
        assert replace(again, lag_s=report.lag_s) == report


# Every robot that is shipped stands through the demo with mass, goes to rest, and moves.

pytest.importorskip("mujoco")


@pytest.mark.long
def test_what_moved_is_the_simulated_body_and_not_what_was_sent() -> None:
    """A body that froze has gone no way, whatever goals were sent to it."""
    run = play(synthetic_performer().cut(0.0, 2.5), RunOptions(robot="op3", bus="physics"))
    moved, physics = measure(run), run.physics
    assert physics is not None and moved.hand_path_ratio is not None and moved.hand_path_ratio > 0.5
    frozen = replace(physics, body=np.tile(physics.body[len(physics.body) // 2], (len(physics.body), 1)))
    still = measure(replace(run, physics=frozen))
    assert still.hand_path_ratio == 0.0 and not still.pelvis_excursion_ratio and not still.foot_path_ratio
    assert (still.travelled_m.robot, still.turned_deg.robot) == (0.0, 0.0)
    assert moved.pelvis_height_mm is not None and still.pelvis_height_mm is not None
    assert still.pelvis_height_mm.p95 > 2.0 * moved.pelvis_height_mm.p95
    assert moved.reachable_hands_mm is not None and still.reachable_hands_mm is not None
    assert still.reachable_hands_mm["worse"] > 2.0 * moved.reachable_hands_mm["worse"]


@pytest.mark.long
@pytest.mark.parametrize("robot", ["op3", "poppy", "toddlerbot", "wolfgang"])
def test_it_stands_through_the_demo_in_physics(robot: str) -> None:
    run = play(synthetic_performer(), RunOptions(robot=robot, bus="physics"))
    end = stood("none", 0, run)
    assert (end.fallen_at, end.stopped) == (None, "")
    report = measure(run)
    assert report.hand_path_ratio is not None and report.hand_path_ratio > 0.7
