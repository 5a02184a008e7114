"""The benchmark of a live tick: what it counts is ours, and adds up."""

import numpy as np
import pytest

from benchmarks.tick_cost import ASKED, PARTS, READING, measure


@pytest.mark.long
def test_parts_are_in_the_tick_and_most_of_it() -> None:
    spent = measure(1.6, parts=True)
    whole, parts = spent["tick"], np.sum([spent[name] for name in PARTS], axis=0)
    assert 50 < len(whole) < 200  # of those that follow
    np.testing.assert_allclose(spent[ASKED], whole - spent[READING])
    assert (spent[ASKED] > 0.0).all() and (spent[READING] > 0.0).all()
    assert (whole > 0.0).all() and (parts <= whole + 0.05).mean() > 0.99 and parts.sum() > 0.5 * whole.sum()
