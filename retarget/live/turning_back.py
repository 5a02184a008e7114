"""How sensors that were lost are turned when they come back: from how they were shown last, by their weight."""

import numpy as np

from retarget import rotations
from retarget.frames import SensorSample
from retarget.rotations import FloatArray

__all__ = ["TurningBack"]


class TurningBack:
    """Remembers of `count` sensors how they were turned while they took part in full."""

    def __init__(self, count: int) -> None:
        self._last: FloatArray = np.full((count, 4), np.nan)

    def step(self, sample: SensorSample) -> SensorSample:
        """The sample with the orientations of who has not come back yet on the way from the last one known."""
        if sample.weight is None:
            return sample
        whole = sample.valid & (sample.weight >= 1.0)
        if np.count_nonzero(whole) == len(whole):
            self._last = sample.orientation
            return sample
        self._last = np.where(whole[:, None], sample.orientation, self._last)
        back = sample.valid & ~whole & np.isfinite(self._last[:, 0]) & np.isfinite(sample.orientation[:, 0])
        if not back.any():
            return sample
        orientation = sample.orientation.copy()
        orientation[back] = rotations.slerp(self._last[back], orientation[back], sample.weight[back])
        return SensorSample(sample.names, sample.position, orientation, sample.valid, sample.weight)
