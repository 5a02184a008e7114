"""Following and holding: only good data end a hold, and nothing that is followed ever leaps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from retarget.frames import SensorSample
from retarget.live.engagement import PEAK, Engaged, Engagement, EngagementTimes

NAMES = ("head", "l_wrist")
DT = 0.01
TIMES = EngagementTimes()


def sample(x: float, *, valid: tuple[bool, bool] = (True, True)) -> SensorSample:
    position = np.array([[x, 0.0, 1.6], [x, 0.3, 1.0]])
    return SensorSample(NAMES, position, np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)), np.array(valid))


def test_it_begins_with_good_data_for_long_enough_and_a_blend_from_where_the_robot_arrived() -> None:
    engagement, followed = Engagement(sample(0.0)), list[float]()
    for tick in range(200):
        shown = engagement.step(DT * tick, sample(0.2), good=True)
        assert (shown is None) == (DT * tick < TIMES.healthy - 1e-9)
        if shown is not None:
            followed.append(float(shown.position[0, 0]))
    assert followed[0] == pytest.approx(0.0, abs=1e-6) and followed[-1] == 0.2
    steps = np.diff(followed)
    assert (steps >= 0.0).all() and steps.max() <= PEAK * 0.2 / TIMES.blend * DT * 1.01
    assert followed.index(0.2) * DT == pytest.approx(TIMES.blend, abs=2 * DT)


def test_a_long_way_back_is_slow() -> None:
    engagement, followed = Engagement(sample(0.0)), list[float]()
    for tick in range(1000):
        shown = engagement.step(DT * tick, sample(3.0), good=True)
        if shown is not None:
            followed.append(float(shown.position[0, 0]))
    assert np.diff(followed).max() <= TIMES.speed * DT * 1.001 and followed[-1] == 3.0


def test_flapping_data_are_not_followed() -> None:
    engagement = Engagement(sample(0.0))
    for tick in range(500):
        assert engagement.step(DT * tick, sample(0.1), good=tick % 40 != 0) is None
    assert engagement.state is Engaged.HOLDING


def test_a_clutch_lets_go_and_takes_up_again_without_a_leap() -> None:
    engagement = Engagement(sample(0.0))
    last, largest = 0.0, 0.0
    for tick in range(900):
        engagement.wanted = not 300 <= tick < 500
        place = 0.0 if tick < 300 else 1.0  # the performer walks while the clutch is out
        shown = engagement.step(DT * tick, sample(place), good=True)
        if shown is not None:
            largest, last = max(largest, abs(float(shown.position[0, 0]) - last)), float(shown.position[0, 0])
        elif tick > 300:
            assert float(engagement.shown.position[0, 0]) == 0.0
    assert last == 1.0 and largest <= TIMES.speed * DT * 1.001


def test_a_sensor_that_was_not_held_is_as_it_is() -> None:
    engagement = Engagement(sample(0.0, valid=(True, False)))
    for tick in range(60):
        shown = engagement.step(DT * tick, sample(1.0), good=True)
    assert shown is not None and shown.position[0, 0] < 0.05 and shown.position[1, 0] == 1.0


@settings(max_examples=60)
@given(st.lists(st.tuples(st.booleans(), st.floats(-0.004, 0.004)), min_size=1, max_size=400))
def test_whatever_happens_what_is_followed_goes_on_from_where_it_was(moves: list[tuple[bool, float]]) -> None:
    engagement, place, last = Engagement(sample(0.0)), 0.0, 0.0
    fastest = TIMES.speed * DT + 0.004
    for tick, (good, step) in enumerate(moves):
        place += step
        shown = engagement.step(DT * tick, sample(place), good=good)
        if shown is not None:
            assert abs(float(shown.position[0, 0]) - last) <= fastest + 1e-9
            last = float(shown.position[0, 0])


def test_a_great_turn_back_takes_its_time_too() -> None:
    engagement, turned = Engagement(sample(0.0)), sample(0.0)
    turned.orientation[:] = [0.0, 0.0, 0.0, 1.0]  # by pi
    angles = []
    for tick in range(1000):
        shown = engagement.step(DT * tick, turned, good=True)
        if shown is not None:
            angles.append(float(2.0 * np.arctan2(shown.orientation[0, 3], shown.orientation[0, 0])))
    assert np.diff(angles).max() <= TIMES.turn * DT * 1.001 and angles[-1] == pytest.approx(np.pi)


def test_the_robot_has_all_of_its_speed_when_the_way_back_is_over_and_never_in_a_hold() -> None:
    engagement, settled = Engagement(sample(0.0)), list[float]()
    for tick in range(300):
        shown = engagement.step(DT * tick, sample(0.1), good=tick < 280)
        settled.append(engagement.settled)
        assert shown is not None or engagement.settled == 0.0
    back = round((TIMES.healthy + TIMES.blend) / DT)
    assert max(settled[:back]) < 0.01 and settled[279] == 1.0 and settled[299] == 0.0
    assert 0.0 <= np.diff(settled[:280]).max() <= DT / TIMES.blend * 1.001
    engagement.begin(sample(1.0))
    assert engagement.settled == 0.0 and engagement.state is Engaged.HOLDING
    assert engagement.step(5.0, sample(1.0), good=True) is None
