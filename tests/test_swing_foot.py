"""The sole that carries nothing: how far it goes, and that it is put down where it was."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from retarget.swing_foot import HIGH, LOW, WAY, SwingFoot

DT, LEG = 0.008, 0.2
PLACE = np.array([0.01, 0.05, 0.0])


def offsets() -> st.SearchStrategy[tuple[float, float, float]]:
    return st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))


@settings(max_examples=20)
@given(asked=st.lists(offsets(), min_size=1, max_size=5), outward=st.sampled_from([1.0, -1.0]))
def test_it_stays_within_bounds_and_comes_back(asked: list[tuple[float, float, float]], outward: float) -> None:
    foot = SwingFoot(PLACE, outward=outward, leg=LEG)
    up = np.array([foot.follow(offset, DT).copy() for offset in asked for _ in range(100)]) - PLACE
    assert up[:, 2].min() >= 0.0 and up[:, 2].max() <= HIGH * LEG + 1e-9
    assert np.abs(up[:, 0]).max() <= WAY * LEG + 1e-9
    assert (outward * up[:, 1]).min() >= -1e-9 and (outward * up[:, 1]).max() <= WAY * LEG + 1e-9
    assert up[-1, 2] >= LOW * LEG - 1e-9
    aside = np.abs(up[:, :2]).max(axis=1) > 1e-9
    assert not aside.any() or up[aside, 2].min() > 0.5 * LOW * LEG
    down = np.array([foot.lower(DT).copy() for _ in range(400)]) - PLACE
    assert np.abs(down[-1]).max() < 1e-6
    low = down[:, 2] < 0.5 * LOW * LEG
    assert np.abs(down[low, :2]).max() < 1.1e-3, "straight down at the end"


def test_it_goes_on_from_where_it_was_sent() -> None:
    foot = SwingFoot(PLACE, outward=1.0, leg=LEG)
    foot.restart([0.02, 0.06, 0.03])
    assert np.abs(np.array(foot.lower(DT)) - [0.02, 0.06, 0.03]).max() < 1e-4
