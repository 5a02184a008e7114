"""The posture that is natural at the height of the head."""

import numpy as np
import pytest

from retarget.crouch import Crouch
from retarget.human import build_human
from retarget.human_dimensions import proportional_dimensions


def test_from_upright_to_lowered_with_the_head() -> None:
    human = build_human(proportional_dimensions(1.75))
    crouch = Crouch(human, upright="natural", lowered="crouch")
    upright, lowered = human.posture("natural"), human.posture("crouch")
    assert (crouch.posture(3.0) == upright).all()
    assert crouch.posture(0.1) == pytest.approx(lowered)
    heights = np.linspace(0.3, 1.6, 50)
    shares = [crouch.share(height) for height in heights]
    assert all(np.diff(shares) <= 0.0) and shares[0] == 1.0 and shares[-1] == 0.0
    middle = heights[np.argmin(np.abs(np.array(shares) - 0.5))]
    assert crouch.posture(middle) == pytest.approx(0.5 * (upright + lowered), abs=0.05)
