"""Latency by stage: the lag of shafts that is known, and stages that sum up to a way that was measured apart."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.latency import measure
from hardware.clock import VirtualClock
from retarget.human.samples import Playback
from retarget.live.playout import LIGHT, OFF, smoothing_delay
from retarget.live.stream_report import TimePercentiles
from retarget.report.findings import latency_line
from retarget.report.latency import latency_of
from retarget.report.measure import measure as measure_run
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.run.run_result import RunResult
from sim.mock_bus import mock_bus
from sim.performer import synthetic_performer

DT = 0.008


@pytest.fixture(scope="module")
def run() -> RunResult:
    options = RunOptions(robot="op3", playback=Playback(end=5.0))
    with prepare(synthetic_performer, options, clock=VirtualClock(), make_bus=mock_bus) as prepared:
        return prepared.run()


def test_shafts_that_are_so_many_ticks_late_are_found_to_be(run: RunResult) -> None:
    assert run.robot is not None
    servo, whole = list[float](), list[float]()
    for ticks in (2, 10):
        late = run.record.q[:, run.robot.servo_columns].copy()
        late[ticks:] = late[:-ticks]
        found = latency_of(replace(run, record=replace(run.record, present=late)))
        assert found is not None and list(found.stages) == ["human", "robot", "bus", "servo"]
        assert found.hand_to_shaft is not None
        servo.append(found.stages["servo"].p50)
        whole.append(found.hand_to_shaft.p50)
    # What the stages before took to compute depends on the machine, and is in both.
    assert servo[1] - servo[0] == pytest.approx(8e3 * DT, abs=0.1)
    assert servo[0] == pytest.approx(2e3 * DT, abs=1e3 * DT)
    assert whole[1] - whole[0] == pytest.approx(8e3 * DT, abs=1e3 * DT)


def test_a_hand_that_stands_still_shows_none(run: RunResult) -> None:
    still = replace(run.record, sensors=np.zeros_like(run.record.sensors))
    found = latency_of(replace(run, record=still))
    assert found is not None and found.hand_to_shaft is None and list(found.stages) == ["bus"]


def test_a_run_of_a_single_tick_shows_none() -> None:
    options = RunOptions(robot="op3", playback=Playback(end=1e-3))
    with prepare(synthetic_performer, options, clock=VirtualClock(), make_bus=mock_bus) as prepared:
        found = latency_of(prepared.run())
    assert found is not None and found.hand_to_shaft is None


def test_the_summary_names_the_stages_also_where_the_whole_way_is_not_known(run: RunResult) -> None:
    report = replace(
        measure_run(run),
        latency_ms={"arrival": TimePercentiles(13.8, 26.8), "bus": TimePercentiles(0.4, 0.9)},
        hand_to_shaft_ms=TimePercentiles(96.3, 138.8),
    )
    assert latency_line(report) == (
        "96 ms from hand to shaft (median; p99 139); medians of its stages, which need not add up to it: arrival 14; "
        "all others below 1"
    )
    assert latency_line(replace(report, hand_to_shaft_ms=None)) == "arrival 14 ms; from hand to shaft it is not known"
    assert latency_line(replace(report, hand_to_shaft_ms=None, latency_ms=None)) == ""


def test_smoothing_delays_a_slow_motion_more() -> None:
    assert smoothing_delay(OFF, 1.0) == 0.0 < smoothing_delay(LIGHT, 2.0) < smoothing_delay(LIGHT, 0.5)


@pytest.mark.long
def test_the_stages_of_a_live_run_sum_up_to_the_way_that_is_measured_apart() -> None:
    found = measure("emulator", synthetic_performer(), 20.0)
    assert list(found.report.stages) == ["capture", "arrival", "playout", "filter", "human", "robot", "bus", "servo"]
    apart = 1e3 * float(np.median(found.apart))
    together, whole = found.report.together, found.report.hand_to_shaft
    assert together is not None and whole is not None
    assert together.p50 == pytest.approx(whole.p50, rel=0.05) and whole.p50 == pytest.approx(apart, abs=1e3 * DT)
