"""Limits of validity and their range."""

from typing import Any

import pytest

from retarget.errors import UsageError
from retarget.live.engagement import ReacquisitionTimes
from retarget.live.sensor_validity import ValidityLimits


@pytest.mark.parametrize("name", ["fastest", "settled_after", "stale_after", "frozen_after", "reach"])
@pytest.mark.parametrize("wrong", [0.0, -1.0, float("nan")])
def test_limits_out_of_range_are_refused(name: str, wrong: float) -> None:
    limits: dict[str, Any] = {name: wrong}
    with pytest.raises(UsageError):
        ValidityLimits(**limits)


def test_the_room_has_a_height() -> None:
    with pytest.raises(UsageError):
        ValidityLimits(low=1.0, high=1.0)


def test_a_lost_or_frozen_sensor_has_no_weight_in_300_ms() -> None:
    """With one capture and one tick at 100 Hz of delay."""
    limits, times = ValidityLimits(), ReacquisitionTimes()
    for limit in (limits.stale_after, limits.frozen_after):
        assert limit + times.leave + 0.02 <= 0.3
