"""Whatever comes, trust neither raises nor grows."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from retarget.live.trust import MAX_CHANGES, NO_TIME, Trust
from retarget.live.trust_state import TrustState
from trust_rig import NAMES, walk

VALUE = st.floats(width=64) | st.sampled_from([0.0, 1.0, 0.1, np.nan, np.inf, -1e300])


@settings(max_examples=25)
@given(st.data())
def test_anything_may_come(data: st.DataObject) -> None:
    trust = Trust(NAMES)
    draw = data.draw
    for _ in range(draw(st.integers(1, 6))):
        rows = np.array(draw(st.lists(st.integers(0, 5), unique=True)), dtype=np.intp)
        count = len(rows)
        numbers = np.array(draw(st.lists(VALUE, min_size=7 * count, max_size=7 * count))).reshape(count, 7)
        if draw(st.booleans()):
            numbers[:, 3:] = (1.0, 0.0, 0.0, 0.0)
        tracked = np.array(draw(st.lists(st.booleans(), min_size=count, max_size=count)), dtype=bool)
        usable = trust.take(rows, draw(VALUE), position=numbers[:, :3], orientation=numbers[:, 3:], tracked=tracked)
        assert not (usable & ~tracked).any() and np.isfinite(numbers[usable, :3]).all()
        states = trust.judge(draw(VALUE))
        assert states.max() <= TrustState.OUT_OF_RANGE
    assert len(trust.messages()) <= MAX_CHANGES


def test_memory_is_bounded_where_nobody_listens() -> None:
    stream = walk(1.0)
    trust = Trust(NAMES)
    for i in range(400):
        time = 0.2 * i
        trust.take(
            np.arange(6), time, position=stream.position[0], orientation=stream.orientation[0], tracked=np.ones(6, bool)
        )
        trust.judge(time)
        trust.judge(time + 0.19)
    assert 1 <= len(trust.messages()) <= MAX_CHANGES and trust.messages() == []


def test_a_time_that_is_none_is_refused() -> None:
    stream, trust = walk(1.0), Trust(NAMES)
    assert not trust.take(
        np.arange(6), np.nan, position=stream.position[0], orientation=stream.orientation[0], tracked=np.ones(6, bool)
    ).any()
    assert trust.refused.reasons == {NO_TIME: 6} and (trust.judge(np.nan) == TrustState.STALE).all()
