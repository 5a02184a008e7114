"""Resampling: rows between rows, never beyond them, and a rate of one's own changes nothing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from exported import angle_between, moved, slider, with_servos
from messages import refuses
from retarget.errors import InputError, UsageError
from retarget.recording.motion import resampled


@given(st.floats(0.5, 400.0), st.integers(1, 60))
def test_rows_are_even_and_within_the_motion(fps: float, rows: int) -> None:
    motion = moved(slider(), rows=rows)
    if rows > 1 and (rows - 1) * fps / 50.0 < 1.0:
        with refuses(UsageError):
            resampled(motion, fps)
        return
    new = resampled(motion, fps)
    assert new.time[0] == motion.time[0] and new.time[-1] <= motion.time[-1] + 1e-9
    assert motion.time[-1] - new.time[-1] < 1.0 / fps + 1e-9
    np.testing.assert_allclose(np.diff(new.time), 1.0 / fps, rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(new.root_quaternion, axis=1), 1.0, atol=1e-12)
    assert (new.joints.max(axis=0) <= motion.joints.max(axis=0) + 1e-12).all()


def test_at_shared_instants_nothing_changes() -> None:
    motion = with_servos(moved(slider(), rows=41))
    for fps, ours, theirs in ((25.0, slice(None), slice(None, None, 2)), (100.0, slice(None, None, 2), slice(None))):
        new = resampled(motion, fps)
        np.testing.assert_allclose(new.joints[ours], motion.joints[theirs], atol=1e-9)
        assert angle_between(new.root_quaternion[ours], motion.root_quaternion[theirs]).max() < 1e-6
        assert new.servos is not None and motion.servos is not None
        np.testing.assert_allclose(new.servos[ours], motion.servos[theirs], atol=1e-9)
        assert new.goal_ticks is None


def test_between_two_rows_lies_the_middle_also_where_the_quaternion_changes_its_sign() -> None:
    motion = moved(slider(), rows=3)
    motion.q[1, 3:7] *= -1.0
    new = resampled(motion, 100.0)
    np.testing.assert_allclose(new.joints[1], motion.joints[:2].mean(axis=0), atol=1e-12)
    halves = angle_between(new.root_quaternion[[1, 1]], motion.root_quaternion[:2])
    assert halves[0] == pytest.approx(halves[1], abs=1e-6) and halves[0] < 2.0


def test_rows_that_come_when_they_like_become_even() -> None:
    motion = moved(slider())
    motion.time[:] = np.sort(np.random.default_rng(3).uniform(0.0, 2.0, len(motion)))
    with refuses(InputError):
        _ = motion.rate_hz
    assert resampled(motion, 30.0).rate_hz == pytest.approx(30.0)


@pytest.mark.parametrize("fps", [0.0, -5.0, float("nan"), float("inf"), 1001.0])
def test_impossible_rates(fps: float) -> None:
    with refuses(UsageError, "--fps"):
        resampled(moved(slider()), fps)
