"""Which row of a recording is shown when."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from retarget.viewer.timeline import Timeline

TIMES = np.arange(-1.0, 4.0, 0.01)


def test_it_plays_as_fast_as_it_happened_or_as_it_is_told() -> None:
    line = Timeline(TIMES)
    assert not line.playing and line.at(100.0) == 0
    line.play(100.0)
    assert line.at(101.005) == 100
    line.speed = 0.5
    assert line.at(103.005) == 200
    line.pause()
    assert line.at(200.0) == 200


def test_it_ends_or_begins_again() -> None:
    line = Timeline(TIMES)
    line.loops = False
    line.play(0.0)
    assert line.at(60.0) == len(TIMES) - 1 and not line.playing
    line.play(60.0)
    assert line.at(60.0) == 0, "played again from the beginning"
    line.loops = True
    assert line.at(60.0 + 4.99 + 0.505) == 50


def test_a_step_stands() -> None:
    line = Timeline(TIMES)
    line.play(0.0)
    line.at(1.005)
    line.step(-1)
    assert line.row == 99 and not line.playing
    line.step(-1000)
    assert line.row == 0
    line.go_to(10**9)
    assert line.row == len(TIMES) - 1


@given(st.lists(st.tuples(st.floats(0.0, 3.0), st.integers(-600, 600), st.booleans()), max_size=20))
def test_it_is_always_somewhere(moves: list[tuple[float, int, bool]]) -> None:
    line, now = Timeline(TIMES), 0.0
    for later, row, plays in moves:
        now += later
        line.go_to(row)
        if plays:
            line.play(now)
        assert 0 <= line.at(now + later) < len(TIMES)


def test_one_row_is_a_recording_too() -> None:
    line = Timeline(np.zeros(1))
    line.play(0.0)
    assert line.at(5.0) == 0
