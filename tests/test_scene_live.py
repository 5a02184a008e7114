"""Live poses: what is taken, what is dropped and counted, and which velocity follows."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from retarget import rotations
from retarget.scene_live import LIVE_SPEED, LIVE_TURN, VELOCITY_HOLDS, LivePose
from retarget.scene_poses import STILL, MovingPose, Pose

UPRIGHT = (1.0, 0.0, 0.0, 0.0)
NAN, INF = math.nan, math.inf
ANY = st.floats(allow_nan=True, allow_infinity=True)


def seen(live: LivePose, time: float) -> MovingPose:
    moving = live.at(time)
    assert moving is not None
    return moving


def test_nothing_before_the_first() -> None:
    live = LivePose()
    assert live.at(0.0) is None
    assert live.age(5.0) == INF


@pytest.mark.parametrize(
    "bad",
    [
        {"position": (NAN, 0, 0)},
        {"position": (0, -INF, 0)},
        {"position": (0, 0, 1001)},
        {"position": (0, 0)},
        {"position": (0, 0, 0, 0)},
        {"position": ("a", 0, 0)},
        {"position": None},
        {"position": (10**400, 0, 0)},
        {"quat": (0, 0, 0, 0)},
        {"quat": (1, 0, NAN, 0)},
        {"quat": (1, 0, 0)},
        {"time": NAN},
        {"time": INF},
        {"time": 0.99},
        {"velocity": (NAN, 0, 0)},
        {"angular_velocity": (0, INF, 0)},
        {"angular_velocity": 3},
    ],
)
def test_bad_updates_are_dropped_and_the_last_good_pose_stays(bad: dict[str, Any]) -> None:
    live = LivePose()
    assert live.update((1, 2, 3), UPRIGHT, time=1.0, velocity=(0.5, 0, 0))
    good: dict[str, Any] = {"position": (4, 5, 6), "quat": UPRIGHT, "time": 1.1}
    held = seen(live, 1.1)
    assert not live.update(**(good | bad))
    assert live.dropped == 1
    assert seen(live, 1.1) == held
    assert live.age(1.1) == pytest.approx(0.1)
    assert live.update(**good)
    assert (live.dropped, seen(live, 1.1).pose) == (1, Pose((4, 5, 6), UPRIGHT))
    assert live.age(1.1) == 0.0


def test_the_velocity_is_that_of_the_last_two_good_poses() -> None:
    live = LivePose()
    live.update((0, 0, 0), UPRIGHT, time=1.0)
    assert seen(live, 1.0) == MovingPose(Pose((0, 0, 0), UPRIGHT))
    live.update((NAN, 0, 0), UPRIGHT, time=1.05)
    live.update((0.1, 0, 0), rotations.from_rotation_vector([0, 0, 0.2]), time=1.1)
    moving = seen(live, 1.1)
    assert moving.linear == pytest.approx((1, 0, 0))
    assert moving.angular == pytest.approx((0, 0, 2))


def test_a_velocity_that_is_told_counts() -> None:
    live = LivePose()
    live.update((0, 0, 0), UPRIGHT, time=1.0, velocity=(0, 1, 0))
    assert seen(live, 1.0).linear == (0, 1, 0)
    live.update((1, 0, 0), UPRIGHT, time=2.0, velocity=(0, 3, 0), angular_velocity=(0, 0, 4))
    assert (seen(live, 2.0).linear, seen(live, 2.0).angular) == ((0, 3, 0), (0, 0, 4))


def test_velocities_are_bounded() -> None:
    live = LivePose()
    live.update((0, 0, 0), UPRIGHT, time=1.0)
    live.update((3, 4, 0), rotations.from_rotation_vector([0, 0, 3]), time=1.0 + 1e-9)
    moving = seen(live, 1.0)
    assert moving.linear == pytest.approx((0.6 * LIVE_SPEED, 0.8 * LIVE_SPEED, 0))
    assert moving.angular == pytest.approx((0, 0, LIVE_TURN))
    live.update((3, 4, 0), UPRIGHT, time=2.0, velocity=(0, 0, -1e6))
    assert seen(live, 2.0).linear == pytest.approx((0, 0, -LIVE_SPEED))


def test_between_updates_it_goes_on_and_in_silence_it_comes_to_rest() -> None:
    live = LivePose()
    live.update((1, 0, 0), UPRIGHT, time=1.0, velocity=(1, 0, 0))
    soon, late = (seen(live, 1.0 + share * VELOCITY_HOLDS) for share in (0.5, 1.1))
    assert (soon.linear, late.linear) == ((1, 0, 0), STILL)
    np.testing.assert_allclose(soon.pose.position, (1.0 + 0.5 * VELOCITY_HOLDS, 0, 0))
    np.testing.assert_allclose(late.pose.position, (1.0 + VELOCITY_HOLDS, 0, 0))


def test_a_slow_tracker_is_followed_at_every_tick() -> None:
    """30 poses a second of what moves at 1 m/s and turns at 2 rad/s, seen 125 times a second, at most a pose late."""
    live, worst = LivePose(), 0.0
    for tick in range(125):
        time = tick / 125.0
        last = int(time * 30.0 + 1e-9) / 30.0
        live.update((last, 0, 0), (np.cos(last), 0, 0, np.sin(last)), time=last)
        there = seen(live, time).pose
        if tick > 10:
            worst = max(worst, abs(there.position[0] - time), abs(there.quat[3] - np.sin(time)))
    assert worst < 1e-9


def test_when_time_begins_anew_nothing_is_known() -> None:
    live = LivePose()
    live.update((1, 0, 0), UPRIGHT, time=100.0)
    live.restart()
    assert live.at(0.0) is None and live.update((2, 0, 0), UPRIGHT, time=0.0)


def test_a_second_update_of_one_time_replaces_the_first() -> None:
    live = LivePose()
    live.update((0, 0, 0), UPRIGHT, time=1.0)
    live.update((1, 0, 0), UPRIGHT, time=1.5)
    assert live.update((2, 0, 0), UPRIGHT, time=1.5)
    assert seen(live, 1.5).linear == pytest.approx((4, 0, 0))


def test_quaternions_are_made_unit() -> None:
    live = LivePose()
    live.update((0, 0, 0), (2, 0, 0, 0), time=0.0)
    assert seen(live, 0.0).pose.quat == UPRIGHT


@given(st.lists(st.tuples(ANY, ANY, ANY, ANY, ANY, ANY), max_size=8))
def test_whatever_comes_what_is_told_is_finite(updates: list[tuple[float, ...]]) -> None:
    live = LivePose()
    for x, y, w, i, time, speed in updates:
        told = live.update((x, y, 0), (w, i, 0, 0), time=time)
        told_more = live.update((0, y, x), (w, i, 0, 0), time=time, velocity=(speed, 0, 0))
        moving = live.at(time)
        assert moving is not None or not (told or told_more)
        if moving is not None:
            numbers = (*moving.pose.position, *moving.pose.quat, *moving.linear, *moving.angular)
            assert all(map(math.isfinite, numbers))
            assert math.hypot(*moving.linear) <= LIVE_SPEED * (1 + 1e-12)
            assert math.hypot(*moving.angular) <= LIVE_TURN * (1 + 1e-12)
    assert live.dropped <= 2 * len(updates)
