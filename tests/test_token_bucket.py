"""The bound on a rate holds over every stretch of time, whatever the clock does."""

from itertools import accumulate

import pytest
from hypothesis import given
from hypothesis import strategies as st

from retarget.live.token_bucket import TokenBucket
from support.messages import refuses

STEPS = st.lists(st.floats(0.0, 0.5) | st.just(0.0), min_size=1, max_size=120)


@given(STEPS, st.floats(0.5, 200.0), st.integers(1, 20))
def test_no_stretch_of_time_holds_more_than_the_burst_and_the_rate(steps: list[float], rate: float, burst: int) -> None:
    bucket = TokenBucket(rate=rate, burst=burst)
    taken = [now for now in accumulate(steps) if bucket.take(now)]
    for first, start in enumerate(taken):
        for last in range(first, len(taken)):
            assert last - first + 1 <= burst + rate * (taken[last] - start) + 1e-6


@given(st.floats(1.0, 500.0), st.integers(1, 20))
def test_what_keeps_to_the_rate_is_never_refused(rate: float, burst: int) -> None:
    bucket = TokenBucket(rate=rate, burst=burst)
    assert all(bucket.take(k * 1.0001 / rate) for k in range(200))


def test_a_full_bucket_gives_its_burst_and_not_one_more() -> None:
    bucket = TokenBucket(rate=10.0, burst=3)
    assert [bucket.take(5.0) for _ in range(4)] == [True, True, True, False]
    assert [bucket.take(5.15), bucket.take(5.15)] == [True, False]
    assert [bucket.take(1e6) for _ in range(4)] == [True, True, True, False]


def test_time_that_goes_back_gives_nothing() -> None:
    bucket = TokenBucket(rate=10.0, burst=1)
    assert bucket.take(100.0)
    assert not bucket.take(50.0) and not bucket.take(100.05) and bucket.take(100.2)


@pytest.mark.parametrize(("rate", "burst"), [(0.0, 1), (-1.0, 1), (float("nan"), 1), (float("inf"), 1), (1.0, 0)])
def test_a_bucket_that_means_nothing_is_refused(rate: float, burst: int) -> None:
    with refuses(ValueError):
        TokenBucket(rate=rate, burst=burst)
