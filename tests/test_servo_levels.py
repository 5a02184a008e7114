"""Bounds that may be exceeded for a while."""

import numpy as np

from hardware.servo_levels import ServoLevels


def test_what_has_no_patience_is_beyond_at_once_and_nan_never_is() -> None:
    levels = ServoLevels([(0.0, 1.0)], [0.0], 4)
    assert levels.beyond(np.array([[1.0, 1.1, -0.1, np.nan]]), 5.0).tolist() == [[False, True, True, False]]
    assert not levels.beyond(np.array([[1.0, 0.0, 0.5, np.nan]]), 5.0).any()


def test_patience_counts_what_lasts_of_each_servo() -> None:
    levels = ServoLevels([(0.0, 1.0)], [0.2], 2)
    seen = [np.array([row]) for row in ([2.0, 0.0], [2.0, 2.0], [2.0, 2.0], [2.0, 0.0], [2.0, 2.0])]
    found = [levels.beyond(row, 0.1 * tick).tolist()[0] for tick, row in enumerate(seen)]
    assert found == [[False, False], [False, False], [True, False], [True, False], [True, False]]
    assert levels.waiting
    levels.beyond(np.zeros((1, 2)), 0.5)
    assert not levels.waiting


def test_forgetting_begins_anew() -> None:
    levels = ServoLevels([(0.0, 1.0)], [0.2], 1)
    levels.beyond(np.array([[2.0]]), 0.0)
    levels.forget()
    assert not levels.waiting
    assert not levels.beyond(np.array([[2.0]]), 1.0).any()
    assert levels.beyond(np.array([[2.0]]), 1.2).all()
