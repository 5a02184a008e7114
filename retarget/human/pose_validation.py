"""Pose validation: which poses of a sensor a person can have, for live streams, recordings and `retarget.Pipeline`.

`retarget._solver.Validity` judges poses and sensors by the limits of this module. `retarget.live.sensor_validity` asks
it about a stream; `JumpDetection` about samples that come at known times, of which it judges movement alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from math import inf

import numpy as np
from numpy.typing import NDArray

from retarget._solver import Validity
from retarget.frames import SensorFrames, SensorSample, mirrored_name
from retarget.human.sensor_intake import FASTEST_M_S
from retarget.rotations import NORM_TOLERANCE
from retarget.types import BoolArray, IntArray


@dataclass(frozen=True, kw_only=True)
class ValidityLimits:
    """Every limit of a performer's sensors: which poses are valid, when a sensor is lost, and how it and the robot come
    back. Lengths in m; times in s, of capture unless said otherwise.

    One pose. reach: horizontally from the origin, along each axis. low, high: of the height. norm_tolerance: of a
    quaternion's norm.

    Speed. fastest: m/s. shortest_step: a shorter time between two poses counts as
    this: stamps taken on arrival are off by 15 ms, and a sender of 200 Hz may repeat a tracker of 60 Hz. swap, hardest:
    a sensor that is reported at the place of its other side has jumped where it is farther from its own place than
    swap + hardest / 2 * time^2; hardest in m/s^2. back_within: time after which a place says nothing more about where
    such a sensor can be. settled_after: a sensor that jumped is accepted again when it went on from its new place for
    this time.

    Age and value. silent_after: the robot holds after this long without a frame, on the local clock. stale_after: time
    without an accepted pose after which a sensor is lost, on the local clock; a feed of 20 Hz may lose one pose of
    three. frozen_after: time of repeating one value while others move. noticeable: how far another sensor must have
    moved in that time, in m and in parts of a unit quaternion (0.0087: one degree). not_in_use_after: from the first
    judgement.

    Coming back. healthy: good data before a sensor comes back, and before a hold ends.
    """

    reach: float = 10.0
    low: float = -1.0
    high: float = 3.0
    norm_tolerance: float = NORM_TOLERANCE
    fastest: float = FASTEST_M_S
    shortest_step: float = 1.0 / 60.0
    swap: float = 0.08
    hardest: float = 50.0
    back_within: float = 0.1
    settled_after: float = 0.5
    silent_after: float = 0.13
    stale_after: float = 0.142
    frozen_after: float = 0.2
    noticeable: tuple[float, float] = (0.01, 0.0087)
    not_in_use_after: float = 3.0
    healthy: float = 0.5


LIMITS = ValidityLimits()


# The state of one sensor at one instant.

StateArray = NDArray[np.uint8]
"""One ValidityState per sensor, (k,)."""


class ValidityState(IntEnum):
    """The validity of a sensor. Only a FRESH sensor is used."""

    FRESH = 0
    """Its last accepted pose is recent, and no other state applies."""
    STALE = 1
    """No pose of it was accepted for too long: it is lost, or was not received yet."""
    FROZEN = 2
    """It repeats one value to the bit while others move: the sender has lost it and does not report that."""
    JUMPED = 3
    """It went farther than a human can, and stays there; also where it changed places with its other side."""
    NOT_IN_USE = 4
    """It was not received since the start."""
    OUT_OF_RANGE = 5
    """Its position is outside the room."""


def other_sides(names: Sequence[str]) -> IntArray:
    """Rows (k,) of the sensors on the other side of k sensors; -1 where a sensor has none."""
    sides = [mirrored_name(name) for name in names]
    rows = [
        names.index(side) if side != name and side in names else -1 for name, side in zip(names, sides, strict=True)
    ]
    return np.array(rows, dtype=np.int64)


# Jump detection in samples that come at known times: of a recording, and of a caller.

MOVEMENT = ValidityLimits(reach=inf, low=-inf, high=inf, norm_tolerance=inf, frozen_after=inf, not_in_use_after=inf)
"""Movement alone: a recording may leave any room, and marks itself which of its sensors are lost."""


class JumpDetection:
    """Takes a sensor out of samples while it moves as no person can, until it is back or has stayed where it is.

    A sensor that has just jumped stays where it was, as in a live stream: most jumps come back. When that is too long
    ago it is not valid, and `jumped` (k,) until it is valid again.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._validity = Validity(other_sides(names), MOVEMENT)
        self._rows = np.arange(len(names))
        self._none: BoolArray = np.zeros(len(names), dtype=bool)
        self._position, self._orientation = np.full((len(names), 3), np.nan), np.full((len(names), 4), np.nan)
        self.jumped = self._none

    def step(self, time: float, sample: SensorSample) -> SensorSample:
        """The sample of `time`, s of the performer, without what jumps; the sample itself where nothing does."""
        position, orientation = np.ascontiguousarray(sample.position), np.ascontiguousarray(sample.orientation)
        verdicts = self._validity.take(self._rows, time, position, orientation, sample.valid)
        if verdicts is None:
            self._position, self._orientation, self.jumped = position, orientation, self._none
            return sample
        usable = verdicts == 0
        refused = sample.valid & ~usable
        self._position = np.where(usable[:, None], position, self._position)
        self._orientation = np.where(usable[:, None], orientation, self._orientation)
        self.jumped = refused & (self._validity.judge(time) == ValidityState.JUMPED)
        if not refused.any():
            return sample
        position = np.where(refused[:, None], self._position, position)
        orientation = np.where(refused[:, None], self._orientation, orientation)
        position[self.jumped], orientation[self.jumped] = np.nan, np.nan
        return replace(sample, position=position, orientation=orientation, valid=sample.valid & ~self.jumped)


def without_jumps(frames: SensorFrames) -> SensorFrames:
    """The frames of a recording without what jumps; the frames themselves where nothing does.

    Recordings are looked at before they are laid on ticks, where a jump from one frame to the next is a ramp.
    """
    jumps = JumpDetection(frames.names)
    position, orientation, valid = frames.position, frames.orientation, frames.valid
    for row, time in enumerate(frames.time.tolist()):
        sample = SensorSample(frames.names, frames.position[row], frames.orientation[row], frames.valid[row])
        kept = jumps.step(time, sample)
        if kept is sample:
            continue
        if position is frames.position:
            position, orientation, valid = position.copy(), orientation.copy(), valid.copy()
        position[row], orientation[row], valid[row] = kept.position, kept.orientation, kept.valid
    if position is frames.position:
        return frames
    return replace(frames, position=position, orientation=orientation, valid=valid)
