"""Nothing is asked further away than a body reaches."""

from pathlib import Path

import numpy as np
import pytest

import people
from retarget.calibration import calibrate
from retarget.human_dimensions import proportional_dimensions
from retarget.reach import Reach

NAMES = ("head", "l_wrist", "l_ankle")


def test_far_sensors_come_back_along_their_line_to_the_head() -> None:
    reach = Reach(NAMES, NAMES, proportional_dimensions(1.75))
    position = np.array([[0.0, 0.0, 1.6], [3.0, 0.0, 1.6], [0.0, 0.1, 0.1]])
    reach.clamp(position, np.ones(3, dtype=bool))
    assert 0.7 < position[1, 0] < 1.1 and position[1, 1:] == pytest.approx([0.0, 1.6])
    assert position[2] == pytest.approx([0.0, 0.1, 0.1])


def test_without_the_anchor_nothing_is_known() -> None:
    reach = Reach(NAMES, NAMES, proportional_dimensions(1.75))
    position = np.array([[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    reach.clamp(position, np.array([False, True, True]))
    assert position[1, 0] == 9.0


@pytest.mark.parametrize("name", people.TRIALS)
@pytest.mark.parametrize("anchored", ["head", "pelvis"])
def test_people_stay_within(shared: Path, name: str, anchored: str) -> None:
    frames = people.trial(shared, name)
    names = tuple(one for one in frames.names if anchored == "pelvis" or one != "pelvis")
    reach = Reach(names, names, calibrate(frames))
    chosen = frames.select(names)
    for measured in chosen.position[::5]:
        position = measured.copy()
        reach.clamp(position, np.ones(len(names), dtype=bool))
        assert (position == measured).all()
