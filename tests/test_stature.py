"""Height of a body along its bones."""

import numpy as np
import pytest

from retarget.frames import Skeleton
from retarget.stature import ANKLE, HEAD_CENTRE, stature

NAMES = ("l_hip", "r_hip", "l_knee", "l_ankle", "chest", "neck", "head")


def body(spread: float) -> Skeleton:
    """A body of 1.8 (proportions of Drillis and Contini) with its legs spread (rad) in the rest pose."""
    down = np.array([0.0, np.sin(spread), -np.cos(spread)])
    hip = np.array([0.0, 0.1, 0.0])
    knee = hip + 0.245 * 1.8 * down
    heights = np.array([0.65, 0.82, HEAD_CENTRE]) - ANKLE - 0.491
    trunk = np.outer(heights * 1.8, [0.0, 0.0, 1.0])
    return Skeleton(NAMES, np.stack([hip, -hip, knee, knee + 0.246 * 1.8 * down, *trunk]))


@pytest.mark.parametrize("spread", [0.0, 0.35, 1.0])
def test_the_way_the_rest_pose_stands_does_not_matter(spread: float) -> None:
    assert stature(body(spread)) == pytest.approx(1.8)


def test_a_missing_chest_is_left_out_and_a_missing_leg_is_not() -> None:
    whole = body(0.2)
    without = [i for i, name in enumerate(NAMES) if name != "chest"]
    assert stature(Skeleton(tuple(NAMES[i] for i in without), whole.position[without])) == pytest.approx(1.8)
    assert stature(Skeleton(NAMES[1:], whole.position[1:])) is None
