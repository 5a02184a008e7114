"""Room for cycles: every array has a row per cycle, of the width that a run has."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from retarget.recording.cycles import Asked, Boundary, Cursor, Done
from retarget.recording.topics import RECORDED
from retarget.run.table import RunTable


@given(st.lists(st.booleans(), max_size=40))
def test_there_are_as_many_cycles_as_looks(looks: list[bool]) -> None:
    turns: list[int] = []
    boundary = Boundary(lambda: turns.append(1))
    for look in looks:
        (boundary.look if look else boundary.before)()
    boundary.before()
    assert len(turns) == sum(looks)


DT = 0.008


def recorded(index: list[int], follow: int) -> RunTable:
    """Cycles, of which those from `follow` on follow."""
    cycles = RunTable.empty(len(index), {"servos": 3}, RECORDED)
    cycles.index[:] = index
    cycles.clock[:] = DT * np.array(index)[:, None]
    cycles.sampled[0] = Done.WELL
    cycles.sampled[cycles.index >= follow] = Done.WELL
    return cycles


def played(cursor: Cursor, count: int, *, follow: int) -> list[int]:
    """Rows of so many cycles of a run that begins to follow in its cycle `follow`."""
    rows = []
    for cycle in range(count):
        cursor.look()
        if cycle >= follow:
            cursor.follow()
        rows.append(cursor.row)
        cursor.before()
    return rows


def test_the_same_run_is_the_same_cycle_for_cycle() -> None:
    cursor = Cursor(recorded(list(range(10)), 4), has_robot=True, dt=DT)
    assert played(cursor, 10, follow=4) == list(range(10)) and cursor.clock_lead == pytest.approx(0.0, abs=DT)


def test_lost_cycles_are_not_those_before_them() -> None:
    cycles = recorded([0, 1, 2, 5, 6], 1)
    cycles.asked[2] = Asked.STOP
    cursor = Cursor(cycles, has_robot=True, dt=DT)
    rows, known, stops = [], [], []
    for _ in range(7):
        cursor.look()
        if cursor.cycle:
            cursor.follow()
        rows.append(cursor.row)
        known.append(cursor.recorded)
        stops.append(cursor.asked(Asked.STOP))
        cursor.before()
    assert rows == [0, 1, 2, 2, 2, 3, 4] and known == [True, True, True, False, False, True, True]
    assert np.flatnonzero(stops).tolist() == [2]
