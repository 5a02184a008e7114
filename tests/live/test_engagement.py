"""Following and holding: only good data end a hold, and the followed sample never jumps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from retarget.frames import SensorSample
from retarget.human.pose_validation import LIMITS, ValidityState
from retarget.live.sensor_validity import LONGEST_STEP, PEAK, Engagement, ReacquisitionBlend
from retarget.rotations import from_axis_angle

NAMES = ("head", "l_wrist")
DT = 0.01


def sample(x: float, *, valid: tuple[bool, bool] = (True, True)) -> SensorSample:
    position = np.array([[x, 0.0, 1.6], [x, 0.3, 1.0]])
    return SensorSample(NAMES, position, np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)), np.array(valid))


def test_it_begins_with_good_data_for_long_enough_and_a_blend_from_the_approached_sample() -> None:
    engagement, followed = Engagement(sample(0.0)), list[float]()
    for tick in range(200):
        shown = engagement.step(DT * tick, sample(0.2), good=True)
        assert (shown is None) == (DT * tick < LIMITS.healthy - 1e-9)
        if shown is not None:
            followed.append(float(shown.position[0, 0]))
    assert followed[0] == pytest.approx(0.0, abs=1e-6) and followed[-1] == 0.2
    steps = np.diff(followed)
    assert (steps >= 0.0).all() and steps.max() <= PEAK * 0.2 / LIMITS.blend * DT * 1.01
    assert followed.index(0.2) * DT == pytest.approx(LIMITS.blend, abs=2 * DT)


def test_a_clutch_lets_go_and_takes_up_again_without_a_jump() -> None:
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
    assert last == 1.0 and largest <= LIMITS.blend_speed * DT * 1.001


@settings(max_examples=60)
@given(st.lists(st.tuples(st.booleans(), st.floats(-0.004, 0.004)), min_size=1, max_size=400))
def test_whatever_happens_what_is_followed_goes_on_from_where_it_was(moves: list[tuple[bool, float]]) -> None:
    engagement, place, last = Engagement(sample(0.0)), 0.0, 0.0
    fastest = LIMITS.blend_speed * DT + 0.004
    for tick, (good, step) in enumerate(moves):
        place += step
        shown = engagement.step(DT * tick, sample(place), good=good)
        if shown is not None:
            assert abs(float(shown.position[0, 0]) - last) <= fastest + 1e-9
            last = float(shown.position[0, 0])


def test_the_robot_has_all_of_its_speed_after_the_blend_and_never_in_a_hold() -> None:
    engagement, settled = Engagement(sample(0.0)), list[float]()
    for tick in range(300):
        shown = engagement.step(DT * tick, sample(0.1), good=tick < 280)
        settled.append(engagement.settled)
        assert shown is not None or engagement.settled == 0.0
    back = round((LIMITS.healthy + LIMITS.blend) / DT)
    assert max(settled[:back]) < 0.01 and settled[279] == 1.0 and settled[299] == 0.0
    assert 0.0 <= np.diff(settled[:280]).max() <= DT / LIMITS.blend * 1.001


def test_after_a_long_blend_the_speed_rises_as_slowly() -> None:
    engagement, settled = Engagement(sample(0.0)), list[float]()
    for tick in range(1200):
        engagement.step(DT * tick, sample(1.0), good=True)
        settled.append(engagement.settled)
    rises = DT * np.count_nonzero((np.array(settled) > 0.0) & (np.array(settled) < 1.0))
    assert rises >= 1.0 / LIMITS.blend_speed and settled[-1] == 1.0  # no sooner than at the fastest speed


FRESH = np.array([ValidityState.FRESH], dtype=np.uint8)
LOST = np.array([ValidityState.STALE], dtype=np.uint8)


def weights(states: list[np.ndarray], *, full: bool = True) -> np.ndarray:
    reacquisition = ReacquisitionBlend(1)
    if full:
        reacquisition.start(FRESH)
    return np.array([reacquisition.step(state, DT)[0] for state in states])


def test_no_sensor_has_weight_at_first_and_every_fresh_one_after_a_start() -> None:
    assert weights([FRESH], full=False)[0] == 0.0
    assert weights([FRESH])[0] == 1.0
    reacquisition = ReacquisitionBlend(2)
    reacquisition.start(np.array([ValidityState.FRESH, ValidityState.NOT_IN_USE], dtype=np.uint8))
    assert reacquisition.weights.tolist() == [1.0, 0.0]


@settings(max_examples=40)
@given(
    st.lists(
        st.tuples(st.sampled_from([0, 0, 0, 1, 4]), st.sampled_from([0.0, DT, 0.005, 1.0, -1.0])),
        min_size=1,
        max_size=200,
    )
)
def test_weights_never_jump(ticks: list[tuple[int, float]]) -> None:
    reacquisition = ReacquisitionBlend(1)
    reacquisition.start(FRESH)
    before, steepest = 1.0, 1.5 / LIMITS.leave
    for state, dt in ticks:
        after = float(reacquisition.step(np.array([state], dtype=np.uint8), dt)[0])
        assert 0.0 <= after <= 1.0
        assert abs(after - before) <= steepest * min(max(dt, 0.0), LONGEST_STEP) + 1e-12
        before = after


def turn(angle: float) -> np.ndarray:
    return from_axis_angle([0.0, 0.0, 1.0], angle)[None]


def angle(orientation: np.ndarray) -> float:
    return float(2.0 * np.arctan2(orientation[0, 3], orientation[0, 0]))


def test_an_orientation_is_turned_by_its_weight_from_where_it_was_last() -> None:
    blend = ReacquisitionBlend(1)
    blend.start(FRESH)
    assert angle(blend.turned(turn(0.3))) == pytest.approx(0.3)
    got = []
    for i in range(200):
        weight = float(blend.step(LOST if i < 20 else FRESH, DT)[0])
        shown = angle(blend.turned(turn(1.3 if i >= 20 else 0.3)))
        assert shown == pytest.approx(0.3 + weight * (1.0 if i >= 20 else 0.0))
        got.append(shown)
    assert got[60] == pytest.approx(0.3) and got[-1] == pytest.approx(1.3) and np.diff(got).max() < 0.03
