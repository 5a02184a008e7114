"""Which poses are sound, and why the others are not."""

from math import hypot

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from retarget.live.sound_poses import NOT_A_ROTATION, NOT_FINITE, OUT_OF_RANGE, REASONS, UNTRACKED
from retarget.live.trust_limits import TrustLimits
from retarget.live.watched_sensors import watched_sensors
from retarget.rotations import FloatArray

NAN, INF = float("nan"), float("inf")
SOUND = (1.0, 2.0, 0.5, 0.6, 0.0, 0.8, 0.0)
VALUES = st.sampled_from([0.0, 1.0, -1.0, 0.6, 0.8, 1.03, 3.5, 11.0, NAN, INF, -INF, 1e200])


def pose(*numbers: float) -> FloatArray:
    return np.array([numbers])


def reasons(numbers: FloatArray, tracked: list[bool]) -> list[str]:
    """Why each pose is refused, "" where it is not."""
    count = len(numbers)
    watched = watched_sensors(count, TrustLimits())
    position, orientation = numbers[:, :3].copy(), numbers[:, 3:].copy()
    found = watched.take(np.arange(count), 1.0, position, orientation, np.array(tracked, dtype=bool), False)
    return [""] * count if found is None else [REASONS.get(verdict, "") for verdict in found[0].tolist()]


def reason(numbers: FloatArray, tracked: bool = True) -> str:
    return reasons(numbers, [tracked])[0]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_pose_is_sound(sign: float) -> None:
    assert reason(pose(*SOUND[:3], *(sign * part for part in SOUND[3:]))) == ""


def test_an_orientation_may_be_missing_but_not_in_part() -> None:
    assert reason(pose(*SOUND[:3], NAN, NAN, NAN, NAN)) == ""
    for parts in ((NAN, 0.0, 0.0, 0.0), (1.0, NAN, NAN, NAN), (1.0, 0.0, 0.0, NAN), (NAN, NAN, NAN, 1.0)):
        assert reason(pose(*SOUND[:3], *parts)) == NOT_FINITE


@pytest.mark.parametrize("turn", [(0.0,) * 4, (0.97, 0.0, 0.0, 0.0), (0.0, 1.03, 0.0, 0.0), (1.0,) * 4, (1e200,) * 4])
def test_what_is_no_rotation_is_refused(turn: tuple[float, ...]) -> None:
    assert reason(pose(*SOUND[:3], *turn)) == NOT_A_ROTATION


@pytest.mark.parametrize("place", [(10.1, 0, 1), (0, -10.1, 1), (0, 0, 3.1), (0, 0, -1.1), (1e300, 0, 0)])
def test_a_place_outside_the_room_is_refused(place: tuple[float, ...]) -> None:
    assert reason(pose(*place, *SOUND[3:])) == OUT_OF_RANGE


@pytest.mark.parametrize("wrong", [NAN, INF, -INF])
@pytest.mark.parametrize("at", range(7))
def test_what_is_not_finite_is_refused(at: int, wrong: float) -> None:
    numbers = pose(*SOUND)
    numbers[0, at] = wrong
    assert reason(numbers) == NOT_FINITE


def test_what_the_sender_does_not_vouch_for_is_refused() -> None:
    assert reason(pose(*SOUND), tracked=False) == UNTRACKED


@settings(max_examples=100)
@given(st.lists(st.tuples(st.lists(VALUES, min_size=7, max_size=7), st.booleans()), max_size=3))
def test_each_is_judged_by_itself_and_as_said(rows: list[tuple[list[float], bool]]) -> None:
    numbers = np.array([row for row, _ in rows], dtype=float).reshape(len(rows), 7)
    tracked = [vouched for _, vouched in rows]
    limits, found = TrustLimits(), reasons(numbers, tracked)
    for pose_, vouched, why in zip(numbers, tracked, found, strict=True):
        assert why == reason(pose_[None], vouched)
        place, turn = pose_[:3], pose_[3:]
        missing, norm = bool(np.isnan(turn).all()), hypot(*turn.tolist())
        inside = (np.abs(place[:2]) <= limits.reach).all() and limits.low <= place[2] <= limits.high
        finite = np.isfinite(place).all() and (missing or np.isfinite(turn).all())
        turned = missing or abs(norm - 1.0) <= limits.norm_tolerance
        assert (why == "") == bool(vouched and inside and finite and turned)
        assert (why == UNTRACKED) == (not vouched)
        assert (why == OUT_OF_RANGE) == bool(vouched and finite and turned and not inside)
