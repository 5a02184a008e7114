"""Modes that change are counted, per second and by observer."""

import numpy as np
import pytest

from messages import refuses
from retarget.report.motion_metrics import nearest, observer_activity


def test_switches_are_counted_per_second_and_observer() -> None:
    modes = np.zeros((11, 3), dtype=np.uint8)
    modes[3:5, 1] = 1
    modes[7:, 1] = 2
    modes[:, 2] = 1
    found = observer_activity(modes, ("head", "l_arm", "r_arm"), dt=0.1)
    assert found is not None
    assert found.switches.worst == pytest.approx(3.0)
    assert found.switches.mean == pytest.approx(1.0)
    assert found.switches.name == "l_arm"
    assert found.activations == 3
    assert found.active == 1.0
    assert found.reactive == pytest.approx(4 / 11)


def test_a_change_of_active_mode_is_a_switch_but_no_activation() -> None:
    found = observer_activity(np.array([[0], [1], [2], [1], [0]], dtype=np.uint8), ("a",), dt=0.5)
    assert found is not None
    assert (found.switches.worst, found.activations) == (2.0, 1)


def test_calm_observers_have_no_worst_one() -> None:
    found = observer_activity(np.zeros((4, 2), dtype=np.uint8), ("a", "b"), dt=0.1)
    assert found is not None
    assert (found.switches.name, found.switches.worst, found.active, found.reactive) == (None, 0.0, 0.0, 0.0)


def test_nothing_is_known_without_ticks_or_observers() -> None:
    assert observer_activity(np.zeros((0, 2), dtype=np.uint8), ("a", "b"), dt=0.1) is None
    assert observer_activity(np.zeros((5, 0), dtype=np.uint8), (), dt=0.1) is None
    with refuses(ValueError, 1, 2):
        observer_activity(np.zeros((5, 2), dtype=np.uint8), ("a",), dt=0.1)


def test_the_nearest_is_of_what_is_known() -> None:
    assert nearest(np.array([[np.nan, 0.3], [np.inf, -0.1]])) == -0.1
    assert nearest(np.full(3, np.nan)) is None
