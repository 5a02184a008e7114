"""Runs that last longer than there is room for: what is kept has no gap."""

from itertools import pairwise

import numpy as np
import pytest

from live_rig import LiveRig
from messages import shows, shows_lines
from retarget.live.begin import LiveOptions
from retarget.live.performer import LivePerformer
from retarget.report.measure import measure
from retarget.report.motion_metrics import LimitViolations
from retarget.run.loop import Watch
from retarget.run.record import HumanRecord, Phase, Record, RecordRows, Timing
from retarget.run.run_result import RunResult
from sim.faults.sender import FakeSender


def filled(approach: int, follow: int, brake: int, *, close_at: int | None = None) -> Record:
    """The times of so many ticks of each phase, with room for 4, 3 and 2 of them."""
    rows = RecordRows(approach=4, follow=3, brake=2)
    human = HumanRecord.empty(rows.room, nq=0, joint_names=())
    phase = np.zeros(rows.room, dtype=np.int8)
    record = Record(np.zeros(rows.room), phase, human, None, Timing.empty(rows.room))
    for tick in range(approach + follow + brake):
        if close_at == tick:
            rows.close()
        record.time[rows.row] = tick
        rows.filled(approaches=tick + 1 < approach)
    return rows.of(record)


def test_what_comes_after_the_last_room_is_not_kept() -> None:
    record = filled(2, 9, 0, close_at=5)
    assert record.time.tolist() == [0, 1, 2, 3, 4] and record.from_start and not record.to_end
    full = filled(2, 9, 0)
    assert full.time.tolist() == list(range(9)) and not full.to_end  # no more than there are rows
    late = filled(9, 3, 0, close_at=10)
    assert late.time.tolist() == [6, 7, 8, 9] and not (late.from_start or late.to_end)


def played(*, pause: range = range(0), duration: float = 1.0) -> RunResult:
    """A live run in which the operator pauses the robot in these ticks, counted from the first."""
    rig, tick = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=duration)), 0
    with rig.prepared() as prepared:

        def stop_asked() -> bool:
            nonlocal tick
            assert isinstance(prepared.samples, LivePerformer)
            prepared.samples.clutch(engaged=tick not in pause)
            tick += 1
            return False

        return prepared.run(Watch(stop_asked=stop_asked))


def test_an_approach_that_is_held_up_misses_no_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its ticks came in time, and the robot kept its limits."""
    monkeypatch.setattr("retarget.run.record.LONGEST_APPROACH_S", 2.2)
    run = played(pause=range(40, 400))
    sent, report = run.record.robot, measure(run)
    assert sent is not None and report.bus is not None and not run.record.from_start
    assert report.bus.missed_ticks == 0 and report.bus.longest_period_ms == pytest.approx(8.0)
    assert report.limit_violations == LimitViolations(0, 0, 0)
    assert {*run.record.phase.tolist()} == {Phase.APPROACH, Phase.FOLLOW, Phase.BRAKE}
    shows(report.notes)


def test_of_a_long_run_the_beginning_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("retarget.live.begin.KEPT_S", 1.0)
    run = played(duration=2.0)
    report = measure(run)
    assert run.ticks_followed == 125 and not run.record.to_end and report.duration_s == pytest.approx(124 / 125)
    shows_lines(report.notes, 1)
    assert report.bus is not None and report.bus.missed_ticks == 0 and report.limit_violations.acceleration == 0
    # What was sent is compared with the samples of the same ticks.
    assert max(spread.max for spread in report.sensors_mm.values()) < 60.0
    assert run.record.robot is not None
    assert all(after > before for before, after in pairwise(run.record.robot.bus_time.tolist()))
