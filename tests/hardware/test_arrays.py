"""All, any, none: what the methods of an array say."""

import numpy as np
import pytest

from hardware.arrays import all_of, any_of


@pytest.mark.parametrize("shape", [(0,), (1,), (20,), (3, 4), (3, 0)])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_they_say_what_the_array_says(shape: tuple[int, ...], share: float) -> None:
    which = np.random.default_rng(len(shape)).random(shape) < share
    assert all_of(which) is bool(which.all()) and any_of(which) is bool(which.any())


def test_views_are_read_where_they_are() -> None:
    which = np.eye(4, dtype=np.bool_)
    assert any_of(which[:, 1]) and not all_of(which[:, 1])
    assert all_of(which.diagonal()) and not any_of(which[1:, 0])
