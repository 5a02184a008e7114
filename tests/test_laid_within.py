"""A way laid out again: the same way, within the speeds, and no change sharper than servos can."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from retarget.laid_within import laid_within
from retarget.rotations import FloatArray

MOST, CHANGE = np.array([0.01, 0.01]), np.array([0.002, 0.002])


def hump(height: float, ticks: int) -> FloatArray:
    """There, faster than it may be in the middle, at rest at both ends."""
    s = np.linspace(0.0, 1.0, ticks)
    return np.outer(s**3 * (10.0 - 15.0 * s + 6.0 * s**2), [height, -0.5 * height])


def test_what_keeps_the_speeds_is_left_to_the_bit() -> None:
    rows = hump(0.2, 100)
    assert laid_within(rows, most=MOST, change=CHANGE) is rows
    assert laid_within(rows[:1], most=MOST, change=CHANGE) is not None


@given(height=st.floats(0.5, 3.0), ticks=st.integers(40, 300))
@settings(max_examples=40, deadline=None)
def test_it_keeps_the_speeds_and_goes_from_the_first_row_to_the_last(height: float, ticks: int) -> None:
    rows = hump(height, ticks)
    laid = laid_within(rows, most=MOST, change=CHANGE)
    assert (np.abs(np.diff(laid, axis=0)) <= MOST * (1.0 + 1e-6)).all()
    sharpest = np.maximum(CHANGE, np.abs(np.diff(rows, n=2, axis=0)).max(axis=0))
    assert (np.abs(np.diff(laid, n=2, axis=0)) <= sharpest * (1.0 + 1e-6)).all()
    np.testing.assert_allclose(laid[0], rows[0], atol=1e-12)
    np.testing.assert_allclose(laid[-1], rows[-1], atol=1e-12)
    np.testing.assert_allclose(laid[:, 1], -0.5 * laid[:, 0], atol=1e-9)


def test_it_is_slower_only_where_it_must() -> None:
    rows = np.concatenate([hump(0.1, 300), 0.1 * np.array([1.0, -0.5]) + hump(3.0, 100)])
    laid = laid_within(rows, most=MOST, change=CHANGE)
    uniform = len(rows) * float((np.abs(np.diff(rows, axis=0)) / MOST).max())
    assert len(laid) < 0.5 * uniform
    assert laid[200] == pytest.approx(rows[200], abs=1e-12)
