"""How near a decoded camera is to what the renderer knows: figures of a clip, after one alignment as a run makes it."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from rendered import RATE, Motion
from retarget.sources.camera import SENSORS, CameraDecoder
from retarget.types import BoolArray, FloatArray, IntArray

ARMS = [(f"{side}_{near}", f"{side}_{far}") for side in "lr" for near, far in (("elbow", "wrist"),)]


@dataclass(frozen=True, eq=False)
class Decoded:
    """A clip through the decoder: time (T,) s; position (T, 11, 3) m and tracked (T, 11) of SENSORS; row (T,) of each
    frame in the motion."""

    time: FloatArray
    position: FloatArray
    tracked: BoolArray
    row: IntArray

    def of(self, name: str) -> FloatArray:
        """Track (T, 3) m of a sensor."""
        return self.position[:, SENSORS.index(name)]


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
    shared = [name for name in SENSORS if name != "chest"]
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


def turned_off(clip: Decoded, truth: Motion, near: str, far: str) -> FloatArray:
    """Angles (T,) rad between a segment and the truth, the performer facing x in both."""
    seen, known = clip.of(far) - clip.of(near), (truth.of(far) - truth.of(near))[clip.row]
    cosine = np.sum(seen * known, axis=1) / np.linalg.norm(seen, axis=1) / np.linalg.norm(known, axis=1)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def amplitude_and_lag(time: FloatArray, raw: FloatArray, filtered: FloatArray, hz: float) -> tuple[float, float]:
    """Share of the amplitude of a wave (T,) that is left after filtering, and the lag, s."""
    turns = np.exp(-2j * np.pi * hz * time)
    before, after = (np.sum((track - track.mean()) * turns) for track in (raw, filtered))
    return float(abs(after) / abs(before)), float(-np.angle(after / before) / (2.0 * np.pi * hz))
