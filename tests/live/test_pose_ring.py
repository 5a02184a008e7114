"""The compiled pose ring against a sorted list."""

from bisect import bisect_right

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from messages import refuses
from played import How
from retarget._solver import PoseRing
from retarget.live.playout import EXTRAPOLATION_S, Played
from retarget.rotations import IDENTITY
from retarget.types import FloatArray

DEPTH = 5
COUNT = 3
UNIT = 1.0 / 64.0
"""s; whole numbers of it are exact."""
PUSHES = st.lists(
    st.tuples(st.sets(st.integers(0, COUNT - 1), min_size=1), st.integers(0, 40), st.floats(-2.0, 60.0)), max_size=60
)


def new(count: int, depth: int) -> PoseRing:
    return PoseRing(count, depth=depth, extrapolation=EXTRAPOLATION_S)


def place(row: int, time: float) -> FloatArray:
    """Where a sensor is: no two pairs of times give one line."""
    return np.array([row, time * time, 1.0 / (1.0 + abs(time))])


def push(ring: PoseRing, rows: list[int], time: float) -> tuple[float | None, int, int]:
    turns, valid = np.tile(IDENTITY, (len(rows), 1)), np.ones(len(rows), dtype=bool)
    return ring.push(np.array(rows), time, np.array([place(row, time) for row in rows]), turns, valid)


def expected(row: int, times: list[float], at: float) -> tuple[How, float, FloatArray]:
    """What a list of times shows at one."""
    rank = bisect_right(times, at)
    if not times:
        return How.NONE, np.nan, np.full(3, np.nan)
    if rank == 0:
        return How.LATEST, times[0], place(row, times[0])
    if rank < len(times):
        before, after, time, how = times[rank - 1], times[rank], at, How.INTERPOLATED
    else:
        after = times[-1]
        past = [one for one in times if after - 0.2 <= one <= after - 0.02]
        before = past[-1] if past else after
        time = min(at, after + EXTRAPOLATION_S)
        how = How.HELD if at > time else How.EXTRAPOLATED if past and at > after else How.LATEST
    share = (time - before) / (after - before) if after > before else 0.0
    return how, time, place(row, before) + share * (place(row, after) - place(row, before))


@given(PUSHES)
def test_it_is_a_sorted_list_of_the_newest(pushes: list[tuple[set[int], int, float]]) -> None:
    ring = new(COUNT, DEPTH)
    lists: list[list[float]] = [[] for _ in range(COUNT)]
    for chosen, number, asked in pushes:
        rows, time, at = sorted(chosen), UNIT * number, UNIT * asked
        newest, repeated, too_old = push(ring, rows, time)
        assert newest == max(lists[row][-1] if lists[row] else -np.inf for row in rows)
        assert repeated == sum(time in lists[row] for row in rows)
        full = [row for row in rows if len(lists[row]) == DEPTH and time < lists[row][0]]
        assert too_old == len(full)
        for row in rows:
            if time not in lists[row]:
                lists[row] = sorted([*lists[row], time])[-DEPTH:]
        played = Played(*ring.read(at, at + 1.0))
        for row in range(COUNT):
            how, shown, where = expected(row, lists[row], at)
            assert played.how[row] == how and played.valid[row] == bool(lists[row])
            np.testing.assert_allclose(played.time[row], shown, rtol=0.0, atol=1e-12)
            np.testing.assert_allclose(played.position[row], where, rtol=0.0, atol=1e-9)
            assert played.age[row] == (at + 1.0 - lists[row][-1] if lists[row] else np.inf) or played.age[row] == 0.0


def test_what_is_not_stored_is_counted() -> None:
    ring = new(1, 3)
    counted = [push(ring, [0], time) for time in (1.0, 2.0, 3.0, 2.0, 0.5, 2.5)]
    assert [counts[1:] for counts in counted] == [(0, 0), (0, 0), (0, 0), (1, 0), (0, 1), (0, 0)]
    assert [counted[0][0], counted[1][0], counted[5][0]] == [-np.inf, 1.0, 3.0]
    nothing = ring.push(np.array([0]), 4.0, np.full((1, 3), np.nan), np.full((1, 4), np.nan), np.ones(1, dtype=bool))
    assert nothing == (None, 0, 0)


@pytest.mark.parametrize(("count", "depth"), [(0, 4), (1, 1)])
def test_a_ring_that_keeps_nothing_is_refused(count: int, depth: int) -> None:
    with refuses(ValueError):
        new(count, depth)


def test_bad_arrays_are_refused() -> None:
    ring, one = new(2, 4), np.ones(1, dtype=bool)
    place_, turn = np.zeros((1, 3)), np.array([IDENTITY])
    for rows in ([2], [-1]):
        with refuses(ValueError):
            ring.push(np.array(rows), 1.0, place_, turn, one)
    for arrays in ((place_[:, :2], turn, one), (place_, turn[:, :3], one), (place_, turn, one[:0])):
        with refuses(ValueError):
            ring.push(np.array([0]), 1.0, *arrays)
