"""The made jog and jump are motions of a human: they leave the ground, and five sensors bring them back."""

import numpy as np
import pytest

from benchmarks.paper.made_motion import made_jog, made_jump
from benchmarks.paper.replay import replay
from retarget.frames import SensorFrames
from retarget.schema.priorities import load_priorities


@pytest.mark.parametrize("frames", [made_jog(), made_jump()], ids=["jog", "jump"])
def test_they_are_reconstructed(frames: SensorFrames) -> None:
    ankles = frames.position[:, [frames.index("l_ankle"), frames.index("r_ankle")], 2].min(axis=1)
    assert ankles.min() > 0.03 and np.ptp(ankles) > 0.02
    speed = np.linalg.norm(np.diff(frames.position, axis=0), axis=-1).max() * frames.rate_hz
    assert speed < 12.0
    errors = replay(frames, load_priorities("paper")).sensor_errors
    assert np.nanmean(errors) < 5e-3


def test_the_jump_is_high_and_the_jog_goes_forward() -> None:
    jump, jog = made_jump(), made_jog()
    head = jump.position[:, jump.index("head"), 2]
    assert 0.25 < head.max() - head[0] < 0.5
    assert np.ptp(jog.position[:, jog.index("head"), 0]) > 3.0
