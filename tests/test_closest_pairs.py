"""The search over postures finds what a look at all of them finds, with fewer looks."""

import numpy as np
import pytest

from retarget.metrics.closest_pairs import IntArray, closest_pairs
from retarget.rotations import FloatArray
from support.messages import refuses


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("offset", [0.5, 0.0, -0.3])
def test_all_is_found(seed: int, offset: float) -> None:
    rng = np.random.default_rng(seed)
    steps = rng.normal(0.0, 0.01, (400, 12))
    table = offset + np.abs(0.3 + np.cumsum(steps, axis=0)) - 0.05
    way = np.vstack([np.zeros(12), np.cumsum(np.abs(steps[1:]), axis=0)])
    looked = 0

    def distances(rows: IntArray, pairs: IntArray) -> FloatArray:
        nonlocal looked
        looked += len(rows)
        assert (np.diff(rows) >= 0).all()
        return np.asarray(table[rows, pairs])

    found = closest_pairs(distances, way, tolerances=(1e-6, 1e-3))
    assert found.smallest == table.min()
    assert table[found.row, found.pair] == table.min()
    nearest = table.min(axis=1)
    assert found.deeper == tuple(int(np.count_nonzero(nearest < -depth)) for depth in (1e-6, 1e-3))
    assert looked < (table.size // 2 if offset == 0.5 else table.size)


def test_one_posture_is_enough() -> None:
    found = closest_pairs(lambda rows, pairs: np.array([0.2, -0.1])[pairs], np.zeros((1, 2)), tolerances=(0.0,))
    assert (found.smallest, found.row, found.pair, found.deeper) == (-0.1, 0, 1, (1,))


def test_nothing_is_no_answer() -> None:
    with refuses(ValueError, 0):
        closest_pairs(lambda rows, pairs: np.zeros(0), np.zeros((3, 0)), tolerances=())
