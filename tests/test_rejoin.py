"""Weights of sensors: smooth both ways, out in time, and back only after having been healthy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from retarget.errors import UsageError
from retarget.live.rejoin import LONGEST_STEP, Rejoin, RejoinTimes
from retarget.live.trust_state import TrustState

FRESH = np.array([TrustState.FRESH], dtype=np.uint8)
LOST = np.array([TrustState.STALE], dtype=np.uint8)
DT = 0.01


def weights(states: list[np.ndarray], *, full: bool = True) -> np.ndarray:
    rejoin = Rejoin(1)
    if full:
        rejoin.start(FRESH)
    return np.array([rejoin.step(state, DT)[0] for state in states])


@pytest.mark.parametrize("state", [state for state in TrustState if state is not TrustState.FRESH])
def test_who_is_not_believed_is_out_within_a_tenth_of_a_second(state: TrustState) -> None:
    way = weights([np.array([state], dtype=np.uint8)] * 20)
    assert (way[9:] == 0.0).all() and way[0] > 0.9 and (np.diff(way) <= 0.0).all()


def test_back_by_a_blend_after_half_a_second() -> None:
    way = weights([LOST] * 20 + [FRESH] * 140)[20:]
    assert (way[:49] == 0.0).all() and way[52] > 0.0
    assert way[int(0.5 / DT + 0.375 / DT)] == pytest.approx(0.5, abs=0.03)
    assert (np.diff(way) >= 0.0).all() and way[int(1.25 / DT) + 1] == pytest.approx(1.0)


def test_a_flicker_starts_the_wait_anew() -> None:
    way = weights([LOST] * 20 + ([FRESH] * 45 + [LOST]) * 5)
    assert (way[20:] == 0.0).all()


def test_who_flickers_once_goes_all_the_way_out_first() -> None:
    way = weights([LOST] + [FRESH] * 200)
    assert way[8] == 0.0 and way[-1] == 1.0


def test_nobody_takes_part_at_first_and_whoever_is_believed_after_a_start() -> None:
    assert weights([FRESH], full=False)[0] == 0.0
    assert weights([FRESH])[0] == 1.0
    rejoin = Rejoin(2)
    rejoin.start(np.array([TrustState.FRESH, TrustState.NOT_WORN], dtype=np.uint8))
    assert rejoin.weights.tolist() == [1.0, 0.0]


@settings(max_examples=40)
@given(
    st.lists(
        st.tuples(st.sampled_from([0, 0, 0, 1, 4]), st.sampled_from([0.0, DT, 0.005, 1.0, -1.0])),
        min_size=1,
        max_size=200,
    )
)
def test_weights_never_jump(ticks: list[tuple[int, float]]) -> None:
    rejoin = Rejoin(1)
    rejoin.start(FRESH)
    before, steepest = 1.0, 1.5 / RejoinTimes().leave
    for state, dt in ticks:
        after = float(rejoin.step(np.array([state], dtype=np.uint8), dt)[0])
        assert 0.0 <= after <= 1.0
        assert abs(after - before) <= steepest * min(max(dt, 0.0), LONGEST_STEP) + 1e-12
        before = after


@pytest.mark.parametrize("wrong", [0.0, -1.0, np.nan, np.inf])
def test_times_are_checked(wrong: float) -> None:
    with pytest.raises(UsageError):
        RejoinTimes(blend=wrong)
