"""A way that is gone along slower: the same path, no step longer, no change sharper."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from retarget.paced_way import REJOINING_S, PacedWay

DT = 0.008
REJOINING = round(REJOINING_S / DT)
ROWS = np.cumsum(np.sin(np.linspace(0.0, np.pi, 40)))[:, None] * [1.0, -0.5]


def test_at_full_pace_it_is_row_by_row_to_the_bit() -> None:
    way = PacedWay(ROWS, dt=DT)
    got = [way.next() for _ in range(39)]
    assert np.array_equal(got, ROWS[1:]) and way.done
    assert np.array_equal(way.next(), ROWS[-1])


def test_who_is_there_already_is_done() -> None:
    way = PacedWay(ROWS[:1], dt=DT)
    assert way.done and np.array_equal(way.next(0.5), ROWS[0])


def test_at_half_pace_it_takes_twice_as_long_at_half_the_speed() -> None:
    way = PacedWay(ROWS, dt=DT)
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
    way, before, most = PacedWay(ROWS, dt=DT), ROWS[0], np.abs(np.diff(ROWS, axis=0)).max(axis=0)
    for pace in paces:
        here = way.next(pace)
        assert (np.abs(here - before) <= pace * most + 1e-12).all()
        before = here
    assert way.done and np.array_equal(before, ROWS[-1])


def test_left_and_taken_up_again_it_comes_back_from_where_the_robot_stands_without_a_leap() -> None:
    way, beside = PacedWay(ROWS, dt=DT), np.array([0.3, -0.2])
    for _ in range(10):
        last = way.next()
    way.leave()
    before, here = (way.left, way.done), last + beside
    got = [here]
    while not way.done:
        got.append(way.next(here=here))
    most = np.abs(np.diff(ROWS, axis=0)).max(axis=0) + 1.5 * np.abs(beside) / REJOINING
    steps = np.diff(got, axis=0)
    assert (np.abs(steps) <= most * 1.001).all() and (np.abs(steps[0]) < 0.02 * most).all()
    assert before == (True, False) and np.array_equal(got[-1], ROWS[-1])


def test_left_at_its_end_it_is_gone_back_to() -> None:
    way = PacedWay(ROWS, dt=DT)
    for _ in range(39):
        way.next()
    assert way.done
    way.leave()
    got = [way.next(here=ROWS[-1] + 0.1) for _ in range(REJOINING)]
    assert way.done and np.array_equal(got[-1], ROWS[-1]) and np.abs(got[0] - ROWS[-1]).max() > 0.09


def test_coming_back_onto_it_takes_as_long_at_any_rate() -> None:
    for dt in (0.005, 0.008, 0.02):
        way = PacedWay(ROWS[:1], dt=dt)
        way.leave()
        ticks = 0
        while not way.done:
            way.next(here=ROWS[0] + 0.1)
            ticks += 1
        assert abs(ticks * dt - REJOINING_S) <= dt
