"""Rows on their way to the page: there as they were, and nothing else is taken for one."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from retarget.viewer.wire import LiveRow, RowSizes, pack, unpack

SIZES = RowSizes(robot=27, human=55, servos=20, landmarks=6, observers=21, around=2, truth=29, sensors=5)


def row(*, state: str = "following", why: str = "") -> LiveRow:
    random = np.random.default_rng(7)
    return LiveRow(
        12.5,
        state,
        why,
        random.normal(size=27),
        random.normal(size=55),
        random.normal(size=20),
        random.uniform(20.0, 70.0, 20),
        random.uniform(0.0, 2.3, 20),
        np.vstack([random.normal(size=(5, 3)), np.full((1, 3), np.nan)]),
        random.integers(0, 3, 21).astype(np.uint8),
        random.normal(size=(2, 7)),
        random.normal(size=29),
        np.vstack([random.normal(size=(4, 3)), np.full((1, 3), np.nan)]),
    )


def test_a_row_arrives() -> None:
    sent = row(why="the performer stands behind a pillar")
    got = unpack(pack(sent), SIZES)
    assert got is not None
    assert (got.time, got.state, got.why) == (sent.time, sent.state, sent.why)
    for name in ("robot", "human", "present", "temperature", "current", "asked", "modes", "around", "truth", "sensors"):
        np.testing.assert_allclose(getattr(got, name), getattr(sent, name), atol=1e-5)


@given(st.text(max_size=400))
def test_whatever_is_said_fits(words: str) -> None:
    got = unpack(pack(row(state=words, why=words)), SIZES)
    assert got is not None
    assert words.startswith(got.state) and words.startswith(got.why)
    if len(words.encode()) <= 48 and not words.endswith("\0"):
        assert got.state == got.why == words


@given(st.binary(max_size=2000))
def test_anything_else_is_no_row(data: bytes) -> None:
    whole = len(pack(row()))
    assert (unpack(data, SIZES) is None) == (len(data) != whole)
    assert unpack(pack(row())[:-1], SIZES) is None
