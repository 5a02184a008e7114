"""Following and holding: only good data end a hold, and only a sensor that is valid for long enough is used."""

import numpy as np
import pytest

from retarget.frames import SensorSample
from retarget.human.pose_validation import LIMITS, ValidityState
from retarget.live.sensor_validity import Engagement, SensorDebounce

NAMES = ("head", "l_wrist")
DT = 0.01


def sample(x: float, *, valid: tuple[bool, bool] = (True, True)) -> SensorSample:
    position = np.array([[x, 0.0, 1.6], [x, 0.3, 1.0]])
    return SensorSample(NAMES, position, np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)), np.array(valid))


def test_it_begins_with_good_data_for_long_enough() -> None:
    engagement = Engagement(sample(0.0))
    for tick in range(100):
        given = sample(0.2)
        shown = engagement.step(DT * tick, given, good=True)
        assert (shown is None) == (DT * tick < LIMITS.healthy - 1e-9)
        assert shown is None or shown is given is engagement.shown


@pytest.mark.parametrize("clutch", [True, False])
def test_what_was_followed_last_is_kept_while_it_holds(clutch: bool) -> None:
    """The performer walks while the clutch is out, or data are bad."""
    engagement = Engagement(sample(0.0), following=True)
    for tick in range(900):
        good = not 300 <= tick < 500
        engagement.engaged = good or not clutch
        place = 0.0 if tick < 300 else 1.0
        shown = engagement.step(DT * tick, sample(place), good=good or clutch)
        follows = tick < 300 or DT * (tick - 500) >= LIMITS.healthy - 1e-9
        assert (shown is not None) == follows == engagement.following
        assert float(engagement.shown.position[0, 0]) == (place if follows else 0.0)


def used(states: list[ValidityState], *, first: ValidityState = ValidityState.FRESH) -> list[bool]:
    debounce = SensorDebounce(np.array([first], dtype=np.uint8))
    return [bool(debounce.step(np.array([state], dtype=np.uint8), DT * tick)[0]) for tick, state in enumerate(states)]


def test_a_sensor_that_is_lost_is_used_again_when_it_is_valid_for_long_enough() -> None:
    fresh, lost = ValidityState.FRESH, ValidityState.STALE
    assert used([fresh, fresh]) == [True, True], "what is valid at the start is used at once"
    assert used([fresh], first=lost) == [False]
    found = used([fresh] * 10 + [lost] + [fresh] * 30 + [lost] + [fresh] * 60)
    healthy = round(LIMITS.healthy / DT)
    assert found == [True] * 10 + [False] * 32 + [False] * healthy + [True] * (60 - healthy)
