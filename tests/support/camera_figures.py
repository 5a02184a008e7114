"""How near a decoded camera is to what the renderer knows: figures of a clip, after one alignment as a run makes it."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pytest

from rendered import RATE, Motion
from retarget import Pipeline, SensorSample
from retarget.sources.streams import camera
from retarget.sources.streams.camera import CAMERA_SENSORS, CameraDecoder
from retarget.types import BoolArray, FloatArray, IntArray

WRISTS_M, ARMS_RAD = 0.12, np.deg2rad(20.0)
"""Largest medians: of the distances of wrists from the truth, and of the angles of upper arms and forearms."""
ARMS = [
    (f"{side}_{near}", f"{side}_{far}") for side in "lr" for near, far in (("shoulder", "elbow"), ("elbow", "wrist"))
]


@dataclass(frozen=True, eq=False)
class Decoded:
    """A clip through the decoder: time (T,) s; position (T, 11, 3) m and tracked (T, 11) of CAMERA_SENSORS; row (T,) of
    each frame in the motion."""

    time: FloatArray
    position: FloatArray
    tracked: BoolArray
    row: IntArray

    def of(self, name: str) -> FloatArray:
        """Track (T, 3) m of a sensor."""
        return self.position[:, CAMERA_SENSORS.index(name)]


def decoded(datagrams: Iterable[bytes], *, every: int) -> Decoded:
    """every: pictures of the motion from one datagram to the next."""
    decoder = CameraDecoder()
    frames = [frame for datagram in datagrams for frame in decoder.decode(datagram)]
    numbers = [frame.number for frame in frames if frame.number is not None]
    return Decoded(
        np.array([frame.stamp for frame in frames], float),
        np.array([frame.position for frame in frames]),
        np.array([frame.tracked for frame in frames]),
        every * np.array(numbers),
    )


def errors(clip: Decoded, truth: Motion, names: Iterable[str]) -> FloatArray:
    """Distances (T, k) m of sensors from the truth, once the first second was laid onto it (turned about the vertical
    and moved)."""
    shared = [name for name in CAMERA_SENSORS if name != "chest"]
    seen = np.stack([clip.of(name) for name in shared], axis=1)
    known = np.stack([truth.of(name)[clip.row] for name in shared], axis=1)
    begin = clip.row < RATE
    a, b = np.nanmean(seen[begin], axis=0), known[begin].mean(axis=0)
    good = np.isfinite(a).all(axis=1)
    a0, b0 = a[good].mean(axis=0), b[good].mean(axis=0)
    p, q = (a[good] - a0)[:, :2], (b[good] - b0)[:, :2]
    yaw = np.arctan2(np.sum(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]), np.sum(p * q))
    cosine, sine = np.cos(yaw), np.sin(yaw)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    laid = (seen - a0) @ turn.T + b0
    rows = [shared.index(name) for name in names]
    return np.asarray(np.linalg.norm(laid - known, axis=2)[:, rows])


def arms_off(clip: Decoded, truth: Motion, *, every: int) -> FloatArray:
    """Angles (T, 4) rad between ARMS of the virtual human that follows the clip and the truth, who faces x in both."""
    pipeline, nothing = Pipeline(None, performer="web", rate_hz=RATE / every), np.full((len(CAMERA_SENSORS), 4), np.nan)
    samples = [
        SensorSample(CAMERA_SENSORS, at, nothing, ok) for at, ok in zip(clip.position, clip.tracked, strict=True)
    ]
    pipeline.start(samples[0])
    humans = [pipeline.step(sample, pipeline.dt).human for sample in samples]
    seen = np.array([[human.joint(far) - human.joint(near) for near, far in ARMS] for human in humans])
    known = np.stack([truth.of(far) - truth.of(near) for near, far in ARMS], axis=1)[clip.row]
    cosine = np.sum(seen * known, axis=2) / np.linalg.norm(seen, axis=2) / np.linalg.norm(known, axis=2)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def amplitude_and_lag(time: FloatArray, raw: FloatArray, filtered: FloatArray, hz: float) -> tuple[float, float]:
    """Share of the amplitude of a wave (T,) that is left after filtering, and the lag, s."""
    turns = np.exp(-2j * np.pi * hz * time)
    before, after = (np.sum((track - track.mean()) * turns) for track in (raw, filtered))
    return float(abs(after) / abs(before)), float(-np.angle(after / before) / (2.0 * np.pi * hz))


def check(name: str, datagrams: list[bytes], truth: Motion, *, every: int) -> None:
    """Assert that a clip of `camera_clips` comes out as near to the truth as is promised."""
    clip = decoded(datagrams, every=every)
    if name == "bare":  # taken for a back, whose left is our right: nothing of it is followed
        assert clip.tracked.mean() < 0.05
        return
    assert clip.tracked.all()
    assert np.median(errors(clip, truth, ["l_wrist", "r_wrist"]), axis=0).max() < WRISTS_M
    assert np.median(arms_off(clip, truth, every=every), axis=0).max() < ARMS_RAD
    for foot in {"l_ankle", "r_ankle"} - ({"l_ankle"} if name == "step" else set()):
        assert np.ptp(clip.of(foot), axis=0).max() < 0.03
    if name == "step":
        assert 0.06 < np.ptp(clip.of("l_ankle")[:, 2]) < 0.25  # of 0.2 m
    if name == "front":
        assert np.ptp(clip.of("l_wrist")[:, 2]) > 0.4 and np.ptp(clip.of("r_wrist")[:, 2]) < 0.1
    height = clip.of("pelvis")[:, 2]
    dropped = float(height[truth.time[clip.row] < 1.0].mean() - height.min())
    assert 0.2 < dropped < 0.4 if name == "crouch" else dropped < 0.04
    if name == "still":
        for hand in ("l_wrist", "r_wrist"):
            away = clip.of(hand) - clip.of(hand).mean(axis=0)
            assert np.sqrt(np.sum(away**2, axis=1).mean()) < 0.005


def check_wave(datagrams: list[bytes], hz: float, *, every: int) -> None:
    """Assert that filtering leaves a wave of the left hand as it is: by the body without its filters."""
    with pytest.MonkeyPatch.context() as patch:
        for part in ("ACROSS", "DEPTH"):
            patch.setattr(camera, part, (1e3, 1e3, 1.0))
        raw = decoded(datagrams, every=every)
    clip = decoded(datagrams, every=every)
    waves = (clip.time > clip.time[0] + 2.0) & (clip.time < clip.time[0] + 2.0 + 3.0 / hz)
    before, after = (one.of("l_wrist")[waves, 2] for one in (raw, clip))
    amplitude, lag = amplitude_and_lag(clip.time[waves], before, after, hz)
    assert amplitude > 0.9 and lag < 0.1
