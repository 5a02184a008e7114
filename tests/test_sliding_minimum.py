"""The sliding minimum against the list of everything."""

from math import inf

from hypothesis import given
from hypothesis import strategies as st

from retarget.live.sliding_minimum import SlidingMinimum

STEPS = st.lists(st.tuples(st.floats(0.0, 3.0), st.floats(-10.0, 10.0)), min_size=1, max_size=60)


@given(STEPS)
def test_it_remembers_what_is_young_and_nothing_that_is_old(steps: list[tuple[float, float]]) -> None:
    least, now = SlidingMinimum(2.0, buckets=8), 100.0
    told: list[tuple[float, float]] = []
    for step, value in steps:
        now += step
        least.add(now, value)
        told.append((now, value))
        young = min(value for at, value in told if at >= now - 1.75)
        whole = min(value for at, value in told if at >= now - 2.0 - 1e-9)
        assert whole <= least.at(now) <= young


def test_it_is_empty_after_the_window() -> None:
    least = SlidingMinimum(2.0)
    least.add(5.0, 1.0)
    assert least.at(6.7) == 1.0
    assert least.at(7.01) == inf
    least.add(1e9, 3.0)
    assert least.at(1e9) == 3.0


def test_time_that_goes_back_and_clearing() -> None:
    least = SlidingMinimum(1.0)
    least.add(10.0, 2.0)
    least.add(3.0, 1.0)
    assert least.at(10.0) == 1.0
    least.clear()
    assert least.at(10.0) == inf
    least.add(-4.0, 7.0)
    assert least.at(-4.0) == 7.0
