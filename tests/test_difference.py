"""What differs from a recording, counted and told; goals in ticks, postures of a human to the bit."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from hardware.arrays import TickArray
from recordings import Recorded, record
from retarget.options import RunOptions
from retarget.recording.cycles import Done
from retarget.recording.difference import Difference, goal_difference, posture_difference
from retarget.recording.played import Played


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("difference") / "run.mcap", seconds=0.1)


def sent(found: Played) -> list[tuple[int, TickArray]]:
    cycles = found.cycles
    return [(int(row), cycles.goal[row].copy()) for row in np.flatnonzero(cycles.written != Done.NOT)]


def compared(run: Recorded, goals: list[tuple[int, TickArray]], found: Played | None = None) -> Difference:
    assert run.result.robot is not None
    return goal_difference(found or run.played(), cast(Any, SimpleNamespace(sent=goals)), run.result.robot)


def test_nothing_differs(run: Recorded) -> None:
    goals = sent(run.played())
    found = compared(run, goals)
    assert found.none and found.compared == len(goals) and found.first is None
    assert found.told() == [f"all {len(goals)} goals are as recorded, to the tick"]


def test_one_tick_of_one_joint_is_told_where_and_when(run: Recorded) -> None:
    goals = sent(run.played())
    row = goals[30][0]
    goals[30][1][4] -= 2
    found = compared(run, goals)
    cycles, robot = run.played().cycles, run.result.robot
    assert robot is not None
    assert (found.differ, found.ticks, found.first) == (1, 2, int(cycles.index[row]))
    assert found.most == pytest.approx(2 * 360.0 / 4096.0, rel=1e-6)
    assert found.where == f"of {robot.joint_map.joints[4]} in cycle {found.first}"
    assert found.time_s == pytest.approx(0.008 * (int(cycles.index[row]) - 1), abs=0.02)
    assert found.told()[0].startswith(f"1 of {len(goals)} goals differ, from cycle {found.first}")


def test_goals_that_are_missing_or_more(run: Recorded) -> None:
    goals = sent(run.played())
    found = compared(run, [*goals[:-3], (-1, goals[0][1]), goals[5]])
    assert (found.differ, found.absent, found.extra) == (0, 3, 2) and not found.none
    assert found.told() == ["3 goals were recorded and are not sent now", "2 goals are sent now and were not recorded"]


def test_what_comes_after_a_recording_that_was_cut_off_is_not_more(run: Recorded) -> None:
    whole = run.played()
    cut = replace(whole, recording=replace(whole.recording, damage="it ends early"))
    goals = sent(whole)
    found = compared(run, [*goals, (-1, goals[0][1])], cut)
    assert found.none and not found.whole
    assert found.told() == [f"all {len(goals)} goals that it holds are as recorded, to the tick"]


def test_postures_of_a_human(tmp_path: Path) -> None:
    alone = record(tmp_path / "run.mcap", options=RunOptions(robot="human", bus="none"), seconds=0.1)
    found, q = alone.played(), alone.result.record.human.q.copy()
    assert posture_difference(found, q).none
    q[5, 9] += 0.01
    off = posture_difference(found, q[:-2])
    assert (off.differ, off.absent, off.unit) == (1, 2, "m or rad")
    assert off.most == pytest.approx(0.01, rel=1e-4) and off.where == "of q[9] in cycle 5"
