"""Calibration of a live performer: a second of standing still in the rest pose gives size, floor and heading."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from retarget.errors import InputError
from retarget.frames import SensorSample
from retarget.human_dimensions import HumanDimensions
from retarget.live.alignment import Alignment, align
from retarget.rest_pose import REQUIRED, dimensions_from_rest_pose
from retarget.rotations import FloatArray

__all__ = ["Calibrated", "RestCapture"]

CAPTURE_S = 1.0
"""So long the performer stands still."""
STILL_M = 0.03
"""Farthest that a sensor may be from where it is on average: breathing and swaying move a head by a centimetre."""
FRESH_SHARE = 0.8
"""Of the capture, the share in which a sensor must be fresh to count."""
FEWEST = 20
"""Samples of a capture, at least."""
MOST = 1000
"""Samples that are kept, at most."""


@dataclass(frozen=True, eq=False)
class Calibrated:
    """What a rest pose tells: size; where the stream's world lies; sensors without which it was (they were not fresh).

    sensors: k names, position (k, 3) m: where they were in our world, NaN for those that did not count.
    """

    dimensions: HumanDimensions
    alignment: Alignment
    sensors: tuple[str, ...]
    position: FloatArray
    missing: tuple[str, ...]


class RestCapture:
    """The last CAPTURE_S of samples of the stream's world: `take` them, and ask for the `result` once it is `done`."""

    def __init__(self, *, where: str) -> None:
        """where: the stream, for messages."""
        self._where = where
        self._times: deque[float] = deque()
        self._samples: deque[SensorSample] = deque()
        self._began = np.inf  # [s] the first sample of all

    @property
    def done(self) -> bool:
        """Whether it has lasted long enough."""
        return len(self._times) >= FEWEST and self._times[-1] - self._began >= CAPTURE_S

    def take(self, time: float, sample: SensorSample) -> None:
        """A sample at `time`, s; what is older than CAPTURE_S is forgotten."""
        self._began = min(self._began, time)
        self._times.append(time)
        self._samples.append(sample)
        while self._times[0] < time - CAPTURE_S or len(self._times) > MOST:
            self._times.popleft()
            self._samples.popleft()

    def result(self, *, mass: float | None = None) -> Calibrated:
        """Size and alignment. Raises InputError: no fresh data, not still, not standing in a rest pose."""
        if not self._samples:
            raise self._refused("no data for the calibration", "no fresh sample", "Start the sender")
        names = self._samples[0].names
        track = np.array([sample.position for sample in self._samples])  # (T, k, 3)
        fresh = np.array([sample.valid for sample in self._samples])
        track[~fresh] = np.nan
        counts = fresh.mean(axis=0) >= FRESH_SHARE
        self._refuse_stale([name for name, ok in zip(names, counts, strict=True) if not ok and name in REQUIRED])
        mean = np.full((len(names), 3), np.nan)
        mean[counts] = np.nanmean(track[:, counts], axis=0)
        self._refuse_restless(names, track, mean)
        alignment = align(names, mean, where=self._where)
        standing = alignment.positions(mean)
        known = [index for index, ok in enumerate(counts) if ok]
        dimensions = dimensions_from_rest_pose(
            [names[index] for index in known], standing[known], mass=mass, source=self._where
        )
        missing = tuple(name for name, ok in zip(names, counts, strict=True) if not ok)
        return Calibrated(dimensions, alignment, names, standing, missing)

    def _refuse_stale(self, stale: list[str]) -> None:
        if stale:
            step = "See that these are worn, switched on and named in the performer's file"
            raise self._refused("sensors are not fresh", ", ".join(stale), step)

    def _refuse_restless(self, names: tuple[str, ...], track: FloatArray, mean: FloatArray) -> None:
        away = np.linalg.norm(track - mean, axis=2)
        far = {
            name: float(np.nanmax(away[:, index]))
            for index, name in enumerate(names)
            if np.isfinite(away[:, index]).any() and np.nanmax(away[:, index]) > STILL_M
        }
        if far:
            found = ", ".join(f"{name} moved by {100 * moved:.0f} cm" for name, moved in far.items())
            raise self._refused("the performer did not stand still", found, "Stand still for a second, and try again")

    def _refused(self, what: str, found: str, next_step: str) -> InputError:
        return InputError(what, where=f"{self._where}, calibration", found=found, next_step=next_step)
