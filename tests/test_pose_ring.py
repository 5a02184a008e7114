"""The ring against a sorted list."""

from bisect import bisect_right

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from retarget.live.pose_ring import EMPTY, PoseRing
from retarget.rotations import FloatArray
from retarget.sources.stream_frame import Dropped

DEPTH = 5
COUNT = 3
TOLD = st.lists(
    st.tuples(st.sets(st.integers(0, COUNT - 1), min_size=1), st.integers(0, 30), st.integers(-2, 32)), max_size=60
)


def told(rows: list[int], time: float) -> tuple[FloatArray, FloatArray]:
    """A pose that says when it was and whose."""
    position = np.array([[row, time, 0.0] for row in rows])
    return position, np.array([[time, row, 0.0, 1.0] for row in rows])


@given(TOLD)
def test_it_is_a_sorted_list_of_the_newest(pushes: list[tuple[set[int], int, int]]) -> None:
    ring, dropped = PoseRing(COUNT, depth=DEPTH), Dropped()
    lists: list[list[float]] = [[] for _ in range(COUNT)]
    for chosen, time, asked in pushes:
        rows = sorted(chosen)
        ring.add(np.array(rows), float(time), *told(rows, time), dropped)
        for row in rows:
            if time not in lists[row]:
                lists[row] = sorted([*lists[row], float(time)])[-DEPTH:]
        first, second = ring.around(float(asked))
        for row in range(COUNT):
            rank = bisect_right(lists[row], asked)
            before = lists[row][rank - 1] if rank else None
            assert ring.newest[row] == (lists[row][-1] if lists[row] else EMPTY)
            if before is not None:
                assert ring.time(first)[row] == before
                assert ring.position(first)[row].tolist() == [row, before, 0.0]
                assert ring.orientation(first)[row].tolist() == [before, row, 0.0, 1.0]
            if rank < len(lists[row]):
                assert ring.time(second)[row] == lists[row][rank]
            else:
                assert ring.time(second)[row] <= asked


def test_what_is_not_stored_is_counted() -> None:
    ring, dropped = PoseRing(1, depth=3), Dropped()
    for time in (1.0, 2.0, 3.0, 2.0, 0.5, 2.5):
        ring.add(np.array([0]), time, *told([0], time), dropped)
    assert dropped.reasons == {"repeated": 1, "older than what is kept": 1}
    assert [ring.time(ring.around(at)[0])[0] for at in (2.0, 2.6, 9.0)] == [2.0, 2.5, 3.0]


def test_each_sensor_at_its_own_time_and_clearing() -> None:
    ring, dropped = PoseRing(2), Dropped()
    for time in (1.0, 2.0, 3.0):
        ring.add(np.array([0, 1]), time, *told([0, 1], time), dropped)
    assert ring.time(ring.around(np.array([1.5, 2.5]))[0]).tolist() == [1.0, 2.0]
    ring.clear()
    assert (ring.time(ring.around(5.0)[0]) == EMPTY).all() and np.isnan(ring.position(ring.around(5.0)[0])).all()


@pytest.mark.parametrize("depth", [1, 128])
def test_a_depth_that_cannot_be_counted_is_a_mistake(depth: int) -> None:
    with pytest.raises(AssertionError):
        PoseRing(1, depth=depth)
