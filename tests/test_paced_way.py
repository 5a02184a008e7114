"""A way that is gone along slower: the same path, no step longer, no change sharper."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from retarget.paced_way import PacedWay

ROWS = np.cumsum(np.sin(np.linspace(0.0, np.pi, 40)))[:, None] * [1.0, -0.5]


def test_at_full_pace_it_is_row_by_row_to_the_bit() -> None:
    way = PacedWay(ROWS)
    got = [way.next() for _ in range(39)]
    assert np.array_equal(got, ROWS[1:]) and way.done
    assert np.array_equal(way.next(), ROWS[-1])


def test_who_is_there_already_is_done() -> None:
    way = PacedWay(ROWS[:1])
    assert way.done and np.array_equal(way.next(0.5), ROWS[0])


def test_at_half_pace_it_takes_twice_as_long_at_half_the_speed() -> None:
    way = PacedWay(ROWS)
    got = [ROWS[0]]
    while not way.done:
        got.append(way.next(0.5))
    assert len(got) == 79
    steps, whole = np.diff(got, axis=0), np.diff(ROWS, axis=0)
    np.testing.assert_allclose(np.abs(steps).max(axis=0), 0.5 * np.abs(whole).max(axis=0))
    assert (
        np.abs(np.diff(steps, axis=0)).max(axis=0) <= 0.5 * np.abs(np.diff(whole, axis=0)).max(axis=0) + 1e-12
    ).all()


@given(st.lists(st.floats(0.25, 1.0), min_size=200, max_size=200))
@settings(max_examples=40, deadline=None)
def test_no_step_is_longer_than_its_pace_and_the_end_is_the_end(paces: list[float]) -> None:
    way, before, most = PacedWay(ROWS), ROWS[0], np.abs(np.diff(ROWS, axis=0)).max(axis=0)
    for pace in paces:
        here = way.next(pace)
        assert (np.abs(here - before) <= pace * most + 1e-12).all()
        before = here
    assert way.done and np.array_equal(before, ROWS[-1])
