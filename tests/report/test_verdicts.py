"""Every limit of the page of a report: kept where the numbers say so, and not where they say otherwise."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from retarget.report.measure import measure
from retarget.report.report import Report
from retarget.report.verdicts import Verdict, limit_use, verdicts
from retarget.run.run_result import RunResult
from rig import scripted_run


@pytest.fixture(scope="module")
def run() -> RunResult:
    return scripted_run()


@pytest.fixture(scope="module")
def report(run: RunResult) -> Report:
    found = measure(run)
    clearance = replace(found.min_clearance_mm, self=3.0, scene=7.0, ground=9.0)
    return replace(found, min_clearance_mm=clearance, penetrating_frames=0)


def of(limit: str, run: RunResult, report: Report) -> Verdict:
    (found,) = [verdict for verdict in verdicts(run, report) if verdict.limit == limit]
    return found


def changed(report: Report, part: str, **values: Any) -> Report:
    return replace(report, **{part: replace(getattr(report, part), **values)})


CASES: list[tuple[str, Any, str]] = [
    ("Joint positions", lambda r: changed(r, "limit_violations", position=3), "3 values beyond"),
    ("Joint speeds", lambda r: changed(r, "limit_violations", velocity=1), "1 values beyond"),
    ("Joint accelerations", lambda r: changed(r, "limit_violations", acceleration=2), "2 values beyond"),
    ("Centre of mass", lambda r: replace(r, com_outside_support_frames=4, com_margin_mm=-2.0), "4 ticks, by up to 2.0"),
    (
        "Its own links",
        lambda r: replace(changed(r, "min_clearance_mm", self=-1.5), penetrating_frames=2),
        "1.5 mm inside each other",
    ),
    (
        "Obstacles",
        lambda r: replace(changed(r, "min_clearance_mm", scene=-4.0), penetrating_frames=2),
        "4.0 mm inside each other",
    ),
    (
        "The floor",
        lambda r: replace(changed(r, "min_clearance_mm", ground=-2.0), penetrating_frames=2),
        "2.0 mm inside each other",
    ),
    ("Servos", lambda r: changed(r, "bus", faults=2), "2 faults"),
    ("Ticks", lambda r: changed(r, "bus", missed_ticks=5, longest_period_ms=30.0), "longest took 30.0 ms"),
    ("The run", lambda r: changed(r, "stop", reason="a hand in the way"), "stopped: a hand in the way"),
]


@pytest.mark.parametrize(("limit", "change", "measured"), CASES, ids=[case[0] for case in CASES])
def test_a_limit_that_was_not_kept_is_one_and_all_others_stay(
    limit: str, change: Any, measured: str, run: RunResult, report: Report
) -> None:
    report = changed(report, "bus", missed_ticks=0)
    assert of(limit, run, report).kept
    broken = change(report)
    assert not of(limit, run, broken).kept and measured in of(limit, run, broken).measured
    before = {verdict.limit: verdict.kept for verdict in verdicts(run, report)}
    after = {verdict.limit: verdict.kept for verdict in verdicts(run, broken)}
    assert {name for name in before if before[name] is not after[name]} == {limit}


@pytest.mark.parametrize(("volts", "kept"), [(0.1, False), (-0.1, False), (None, True)])
def test_a_supply_is_within_both_its_limits(volts: float | None, kept: bool, run: RunResult, report: Report) -> None:
    assert run.robot is not None and report.bus is not None and report.bus.lowest_voltage is not None
    low, high = run.robot.profile.safety.voltage
    value = 0.5 * (low + high) if volts is None else high + volts if volts > 0.0 else low + volts
    reported = changed(report, "bus", lowest_voltage=replace(report.bus.lowest_voltage, value=value))
    assert of("Voltage", run, reported).kept is kept


def test_a_servo_at_its_temperature_limit_is_too_warm(run: RunResult, report: Report) -> None:
    assert run.robot is not None and report.bus is not None and report.bus.hottest is not None
    for value, kept in ((run.robot.profile.safety.temperature_c, False), (25.0, True)):
        reported = changed(report, "bus", hottest=replace(report.bus.hottest, value=value))
        assert of("Temperature", run, reported).kept is kept


def test_what_could_not_be_broken_has_no_verdict(run: RunResult, report: Report) -> None:
    bare = replace(
        changed(report, "min_clearance_mm", scene=None, self=None, ground=None),
        bus=None,
        com_outside_support_frames=None,
    )
    assert [verdict.limit for verdict in verdicts(run, bare)] == [
        "Joint positions",
        "Joint speeds",
        "Joint accelerations",
        "The run",
    ]


def test_the_joint_that_turned_used_most_of_its_speed(run: RunResult) -> None:
    """One joint turns by 0.02 rad in 50 ticks; no other moves."""
    use, robot = limit_use(run), run.robot
    assert robot is not None and use.velocity is not None and use.acceleration is not None and use.room is not None
    assert use.velocity.joint == robot.joint_map.joints[1] == use.acceleration.joint
    assert use.velocity.value == pytest.approx(0.02 / 50 / run.clip.dt, rel=0.05)
    assert use.velocity.limit == robot.limits.max_velocity[1]
    name, room = use.room
    at, sent = robot.joint_map.joints.index(name), run.record.robot
    assert sent is not None
    q = np.vstack([sent.start, sent.q[:, robot.servo_columns]])[:, at]
    assert room == pytest.approx(min((q - robot.limits.lower[at]).min(), (robot.limits.upper[at] - q).min()))
