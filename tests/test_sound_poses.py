"""Which poses are sound, told apart by the quick question and the slow one alike."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from retarget.live.sound_poses import NOT_A_ROTATION, NOT_FINITE, OUT_OF_RANGE, UNTRACKED, SoundPoses
from retarget.live.trust_limits import TrustLimits
from retarget.rotations import FloatArray

NAN, INF = float("nan"), float("inf")
SOUND = (1.0, 2.0, 0.5, 0.6, 0.0, 0.8, 0.0)
VALUES = st.sampled_from([0.0, 1.0, -1.0, 0.6, 0.8, 1.03, 3.5, 11.0, NAN, INF, -INF, 1e200])


def pose(*numbers: float) -> FloatArray:
    return np.array([numbers])


def reason(numbers: FloatArray, tracked: bool = True) -> str:
    sound = SoundPoses(TrustLimits())
    verdict = sound.judge(numbers[:, :3], numbers[:, 3:], np.array([tracked]))
    quick = sound.missing_turns(numbers, np.array([tracked]))
    assert (quick is not None) == bool(verdict.sound[0])
    return verdict.reasons[0][0] if verdict.reasons else ""


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
def test_both_questions_have_one_answer(rows: list[tuple[list[float], bool]]) -> None:
    numbers = np.array([row for row, _ in rows], dtype=float).reshape(len(rows), 7)
    tracked = np.array([vouched for _, vouched in rows], dtype=bool)
    sound = SoundPoses(TrustLimits())
    verdict = sound.judge(numbers[:, :3], numbers[:, 3:], tracked)
    missing = sound.missing_turns(numbers, tracked)
    assert (missing is not None) == bool(verdict.sound.all())
    assert sum(count for _, count in verdict.reasons) == np.count_nonzero(~verdict.sound)
    if missing is not None and missing.size:
        assert (missing == ~verdict.oriented).all()
