"""A recording on ticks: frames kept bit for bit where they fall on one, cuts, speed, loops, mirror, refusals."""

import re

import numpy as np
import pytest

from messages import refuses
from retarget.errors import UsageError
from retarget.frames import SensorFrames
from retarget.human.samples import LOOP_LIMIT_S, SEAM_S, Clip, Playback, lay_on_ticks
from retarget.schema.performer import load_performer
from sim.performer import synthetic_performer

FIVE = load_performer("five")


@pytest.fixture(scope="module")
def frames() -> SensorFrames:
    return synthetic_performer()


def lay(frames: SensorFrames, rate_hz: float | None = None, **playback: float | bool) -> Clip:
    return lay_on_ticks(frames, performer=FIVE, playback=Playback(**playback), rate_hz=rate_hz)  # type: ignore[arg-type]


def test_a_run_that_ends_early_played_fewer_frames(frames: SensorFrames) -> None:
    slow, loop = lay(frames, 125.0, speed=0.5), lay(frames, 125.0, loop=True)
    assert slow.frames_played(len(slow)) == len(frames) and slow.frames_played(0) == 0
    assert slow.frames_played(len(slow) // 4) == pytest.approx(len(frames) / 4, abs=1)
    assert loop.frames_played(3 * len(loop.frames)) == 3 * len(frames)


def test_mirror_exchanges_sides(frames: SensorFrames) -> None:
    plain, mirrored = lay(frames, 60.0), lay(frames, 60.0, mirror=True)
    left, right = plain.frames.index("l_wrist"), plain.frames.index("r_wrist")
    flip = np.array([1.0, -1.0, 1.0])
    np.testing.assert_array_equal(mirrored.frames.position[:, left], plain.frames.position[:, right] * flip)
    assert mirrored.frames.names == plain.frames.names


def test_a_loop_closes_without_a_jump(frames: SensorFrames) -> None:
    clip = lay(frames, 100.0, end=1.0, loop=True)
    period = len(clip.frames)
    assert len(clip) == round(LOOP_LIMIT_S * 100.0)
    assert period == pytest.approx((1.0 + SEAM_S) * 100.0, abs=1)
    np.testing.assert_array_equal(clip.sample(period + 3).position, clip.sample(3).position)
    track = clip.frames.position
    steps = np.linalg.norm(np.diff(np.concatenate([track, track[:1]]), axis=0), axis=-1)
    assert steps.max() < 0.05


def test_truth_is_reordered_and_unknown_joints_are_nan(frames: SensorFrames) -> None:
    clip = lay(frames, 60.0)
    truth = clip.truth(("neck", "unknown", "l_knee"), 10)
    assert truth is not None and frames.joints is not None
    np.testing.assert_array_equal(truth[0, 2], frames.joints.of("l_knee")[0])
    assert np.isnan(truth[:, 1]).all()
    assert clip.truth(("unknown",), 10) is None


@pytest.mark.parametrize(
    "playback",
    [
        {"speed": 0.0},
        {"speed": -1.0},
        {"speed": float("nan")},
        {"speed": 1e9},
        {"start": -1.0},
        {"start": float("inf")},
        {"end": float("nan")},
        {"start": 2.0, "end": 1.0},
        {"start": 1.0, "end": 1.0},
    ],
)
def test_impossible_playback_is_refused(playback: dict[str, float]) -> None:
    with refuses(UsageError, re.compile(r"--(speed|start|end)")):
        Playback(**playback)  # type: ignore[arg-type]


def test_what_the_recording_does_not_have_is_refused(frames: SensorFrames) -> None:
    with refuses(UsageError):
        lay(frames, start=500.0)
    with refuses(UsageError, "l_wrist"):
        lay(frames.select(["head", "r_wrist", "l_ankle", "r_ankle"]))
    with refuses(UsageError):
        lay(frames, 1e6)
    with refuses(UsageError):
        lay(frames, 2000.0, speed=0.01)
