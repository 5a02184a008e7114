"""The delay follows the jitter: up at once, down slowly, never above its cap."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from retarget.live.playout_delay import PlayoutDelay


def run(delay: PlayoutDelay, seconds: float, jitter: float, *, start: float, rate: float = 100.0) -> list[float]:
    """The delay after each frame whose lateness lies between 0 and `jitter`, both reached within 10 frames."""
    rng = np.random.default_rng(0)
    found = []
    for i in range(int(seconds * rate)):
        capture = start + i / rate
        lateness = jitter * (i % 10 == 0 or rng.random() * (i % 10 != 1))
        delay.note(capture + lateness, lateness=lateness, gap=1.0 / rate)
        found.append(delay.at(capture + 1.0 / rate))
    return found


def test_it_grows_at_once_and_shrinks_slowly() -> None:
    delay = PlayoutDelay(periods=0.0)
    calm = run(delay, 3.0, 0.002, start=10.0)
    assert calm[-1] == pytest.approx(0.002)
    rough = run(delay, 3.0, 0.025, start=13.0)
    assert rough[0] == pytest.approx(0.025)
    after = run(delay, 10.0, 0.002, start=16.0)
    assert after[100] == pytest.approx(0.025)
    assert after[-1] == pytest.approx(0.002, abs=5e-4)
    assert np.diff(after).min() > -0.05 / 100.0


def test_a_share_of_the_frame_time_is_added() -> None:
    assert run(PlayoutDelay(), 3.0, 0.003, start=10.0)[-1] == pytest.approx(0.013)
    assert run(PlayoutDelay(periods=0.5), 3.0, 0.003, start=10.0, rate=50.0)[-1] == pytest.approx(0.013)


def test_nothing_told_nothing_waited() -> None:
    delay = PlayoutDelay()
    assert delay.at(1.0) == delay.at(2.0) == 0.0
    run(delay, 1.0, 0.01, start=3.0)
    before = delay.at(4.5)
    assert delay.at(1000.0) == before


@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(-1.0, 10.0), st.floats(0.0, 10.0)), max_size=50))
def test_it_is_bounded(told: list[tuple[float, float, float]]) -> None:
    delay, now = PlayoutDelay(cap=0.03), 0.0
    for step, lateness, gap in told:
        now += step
        delay.note(now, lateness=lateness, gap=gap)
        assert 0.0 <= delay.at(now) <= 0.03
