"""Smoothing by name: trembling is halved, motion is hardly late."""

import numpy as np

from retarget.errors import UsageError
from retarget.live.smoothing import SMOOTHINGS, pose_filter
from retarget.rotations import FloatArray
from support.messages import refuses

RATE = 100.0
NOTHING = np.full((1, 4), np.nan)


def smoothed(name: str, track: FloatArray) -> FloatArray:
    """Positions (T,) along x through the filter."""
    made = pose_filter(name, 1)
    if made is None:
        return track
    found = [
        made.step(np.array([k / RATE]), np.array([[x, 0.0, 1.0]]), np.array([[1.0, 0.0, 0.0, 0.0]]))[0][0, 0]
        for k, x in enumerate(track)
    ]
    return np.array(found)


def test_trembling_at_rest_is_halved_and_a_moving_hand_is_hardly_late() -> None:
    noise = np.random.default_rng(2).normal(0.0, 0.001, 2000)
    rest = {name: float(np.std(np.diff(smoothed(name, noise)[500:]))) for name in SMOOTHINGS}
    assert rest["strong"] < rest["light"] < 0.5 * rest["off"]
    moving = np.arange(300) / RATE  # 1 m/s
    late = {name: float((moving - smoothed(name, moving))[-1]) for name in SMOOTHINGS}
    assert late["off"] == 0.0 < late["light"] < 0.015 < late["strong"] < 0.06


def test_an_unknown_name_is_refused() -> None:
    with refuses(UsageError, found="'ligth'"):
        pose_filter("ligth", 1)
